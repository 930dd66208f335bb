//! Items of a file that are left out: their count, and the first cause.

use super::report::{ImportReport, WarningKind};

/// The items of one kind that are left out.
#[derive(Default)]
pub(super) struct LeftOut {
    count: u64,
    first: Option<String>,
}

impl LeftOut {
    /// Counts one; `what` gives its place and its error, and is called only for the first.
    pub(super) fn note(&mut self, what: impl FnOnce() -> String) {
        self.count += 1;
        self.first.get_or_insert_with(what);
    }

    /// The place and the error of the first one.
    pub(super) fn first(&self) -> Option<&str> {
        self.first.as_deref()
    }

    /// Adds them to the report.
    pub(super) fn report(self, kind: WarningKind, report: &mut ImportReport) {
        let detail = self.first.map(|first| format!("first at {first}")).unwrap_or_default();
        report.warn_about(kind, &detail, self.count);
    }
}
