//! Reads the reports of many walks.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

use rayon::prelude::*;
use serde::{Deserialize, de::IgnoredAny};
use thiserror::Error;

use crate::report::schema::{Run, SCHEMA_VERSION, Summary};

/// A report without its frames.
#[derive(Debug, Deserialize)]
pub(super) struct Read {
    schema_version: u32,
    pub(super) run: Run,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) summary: Summary,
    #[serde(default)]
    sweep: Vec<IgnoredAny>,
}

/// Why there is no report to read in a folder.
#[derive(Debug, Error)]
pub(super) enum NoReport {
    #[error("there is no such folder")]
    NoFolder,
    #[error("no report yet: the walk goes on, or its process was killed")]
    Unfinished,
    #[error("it has no report.json")]
    NoFile,
    #[error("report.json cannot be read: {0}")]
    File(#[source] io::Error),
    #[error("report.json has schema version {0}, and this program reads {SCHEMA_VERSION}")]
    Version(u32),
    #[error("report.json is not the report of a walk: {0}")]
    Format(#[source] serde_json::Error),
}

/// A folder, and what was found in it.
type Found = (PathBuf, Result<Box<Read>, NoReport>);

/// The reports in these folders, each once. In the place of a sweep's are those of its walks.
pub(super) fn read(folders: &[PathBuf]) -> Vec<Found> {
    let found: Vec<Found> = folders.par_iter().flat_map_iter(|folder| walks(folder)).collect();
    let mut known = BTreeSet::new();
    // A folder that is not there is known by its name.
    let is_new = |(folder, _): &Found| known.insert(folder.canonicalize().unwrap_or_else(|_| folder.clone()));
    found.into_iter().filter(is_new).collect()
}

fn walks(folder: &Path) -> Vec<Found> {
    let found = report(folder);
    if found.as_ref().is_ok_and(|report| !report.sweep.is_empty()) {
        let walks = folders_with_report(folder);
        if !walks.is_empty() {
            return walks.into_iter().map(|walk| (report(&walk), walk)).map(|(found, walk)| (walk, found)).collect();
        }
    }
    vec![(folder.to_owned(), found)]
}

/// The folders within this one that have a report; those that cannot be read are not known.
fn folders_with_report(folder: &Path) -> Vec<PathBuf> {
    let within = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    within.filter(|path| path.join("report.json").is_file()).collect()
}

fn report(folder: &Path) -> Result<Box<Read>, NoReport> {
    let text = fs::read(folder.join("report.json")).map_err(|cause| match cause.kind() {
        io::ErrorKind::NotFound if !folder.exists() => NoReport::NoFolder,
        io::ErrorKind::NotFound if folder.join("unfinished").exists() => NoReport::Unfinished,
        io::ErrorKind::NotFound => NoReport::NoFile,
        _ => NoReport::File(cause),
    })?;
    match serde_json::from_slice::<Box<Read>>(&text) {
        Ok(report) if report.schema_version == SCHEMA_VERSION => Ok(report),
        Ok(report) => Err(NoReport::Version(report.schema_version)),
        Err(cause) => Err(version(&text).map_or(NoReport::Format(cause), NoReport::Version)),
    }
}

/// The version of a report that could not be read, if it is another one.
fn version(text: &[u8]) -> Option<u32> {
    #[derive(Deserialize)]
    struct Version {
        schema_version: u32,
    }
    let Version { schema_version } = serde_json::from_slice(text).ok()?;
    (schema_version != SCHEMA_VERSION).then_some(schema_version)
}
