//! Reads the reports of many walks.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

use rayon::prelude::*;
use serde::{
    Deserialize,
    de::{DeserializeOwned, IgnoredAny},
};
use thiserror::Error;

use super::comparison::ReadComparison;
use crate::report::schema::{COMPARISON_VERSION, Run, SCHEMA_VERSION, Summary};

/// A report without its frames.
#[derive(Debug, Deserialize)]
pub(super) struct Read {
    pub(super) run: Run,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) summary: Summary,
    #[serde(default)]
    sweep: Vec<IgnoredAny>,
}

/// The report in a folder.
#[derive(Debug)]
pub(super) enum Report {
    /// Of a walk.
    Walk(Box<Read>),
    /// Of a comparison.
    Comparison(ReadComparison),
}

/// Why there is no report to read in a folder.
#[derive(Debug, Error)]
pub(super) enum NoReport {
    #[error("there is no such folder")]
    NoFolder,
    #[error("no report yet: the walk goes on, or its process was killed")]
    Unfinished,
    #[error("it has no report.json and no compare.json")]
    NoFile,
    #[error("{file} cannot be read: {cause}")]
    File { file: &'static str, cause: io::Error },
    #[error("{file} has schema version {found}, and this program reads {known}")]
    Version { file: &'static str, found: u32, known: u32 },
    #[error("{file} is not what `trimaran` writes: {cause}")]
    Format { file: &'static str, cause: serde_json::Error },
}

/// A folder, and what was found in it.
type Found = (PathBuf, Result<Report, NoReport>);

/// The reports in these folders, each once. In the place of a sweep's are those of its walks.
pub(super) fn read(folders: &[PathBuf]) -> Vec<Found> {
    let found: Vec<Found> = folders.par_iter().flat_map_iter(|folder| reports(folder)).collect();
    let mut known = BTreeSet::new();
    // A folder that is not there is known by its name.
    let is_new = |(folder, _): &Found| known.insert(folder.canonicalize().unwrap_or_else(|_| folder.clone()));
    found.into_iter().filter(is_new).collect()
}

fn reports(folder: &Path) -> Vec<Found> {
    let found = report(folder);
    if matches!(&found, Ok(Report::Walk(walk)) if !walk.sweep.is_empty()) {
        let walks = folders_with_report(folder);
        if !walks.is_empty() {
            return walks.into_iter().map(|walk| (walk.clone(), report(&walk))).collect();
        }
    }
    vec![(folder.to_owned(), found)]
}

/// The folders within this one that have a report; those that cannot be read are not known.
fn folders_with_report(folder: &Path) -> Vec<PathBuf> {
    let within = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    within.filter(|path| path.join("report.json").is_file()).collect()
}

fn report(folder: &Path) -> Result<Report, NoReport> {
    if let Some(walk) = file::<Box<Read>>(folder, "report.json", SCHEMA_VERSION)? {
        return Ok(Report::Walk(walk));
    }
    if let Some(comparison) = file(folder, "compare.json", COMPARISON_VERSION)? {
        return Ok(Report::Comparison(comparison));
    }
    Err(if !folder.exists() {
        NoReport::NoFolder
    } else if folder.join("unfinished").exists() {
        NoReport::Unfinished
    } else {
        NoReport::NoFile
    })
}

/// A file of a folder, which has this version of its schema; `None` if it is not there.
fn file<T: DeserializeOwned>(folder: &Path, file: &'static str, known: u32) -> Result<Option<T>, NoReport> {
    #[derive(Deserialize)]
    struct Version {
        schema_version: u32,
    }
    let text = match fs::read(folder.join(file)) {
        Err(cause) if matches!(cause.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        text => text.map_err(|cause| NoReport::File { file, cause })?,
    };
    let format = |cause| NoReport::Format { file, cause };
    let Version { schema_version: found } = serde_json::from_slice(&text).map_err(format)?;
    if found != known {
        return Err(NoReport::Version { file, found, known });
    }
    serde_json::from_slice(&text).map(Some).map_err(format)
}
