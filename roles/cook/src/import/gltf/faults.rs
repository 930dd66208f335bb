//! Broken parts of a document that are left out, with the causes.

use std::collections::BTreeSet;

use super::GltfError;
use crate::import::report::{ImportReport, WarningKind};

/// How many different causes are distinguished: a file can have any number.
const MOST_TOLD: usize = 100;

/// Counts omissions, and keeps the first cause, for an import with nothing left.
#[derive(Default)]
pub(super) struct Faults {
    pub report: ImportReport,
    told: BTreeSet<String>,
    first: Option<GltfError>,
}

impl Faults {
    /// Counts an omission because of `detail`, of `object`.
    pub(super) fn note(&mut self, kind: WarningKind, detail: &str, object: &str) {
        self.note_many(kind, detail, object, 1);
    }

    /// As [`Faults::note`], `count` times.
    pub(super) fn note_many(&mut self, kind: WarningKind, detail: &str, object: &str, count: u64) {
        let is_told = self.told.contains(detail) || self.told.len() < MOST_TOLD;
        let detail = if is_told { detail } else { "" };
        if is_told && !self.told.contains(detail) {
            self.told.insert(detail.to_owned());
        }
        self.report.warn_many(kind, detail, object, count);
    }

    /// Keeps the cause of an omission.
    pub(super) fn cause(&mut self, why: impl FnOnce() -> GltfError) {
        self.first.get_or_insert_with(why);
    }

    /// The first cause.
    pub(super) fn first(&mut self) -> Option<GltfError> {
        self.first.take()
    }
}
