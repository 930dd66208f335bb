//! STEP and IGES: exact surfaces, which a program of its own cuts into triangles.
//!
//! The program is `trimaran-occt`, by Open CASCADE; its source in `roles/cook/occt` says how it is called. It
//! writes glTF, which is read as any other: names, colours, hierarchy and instances come from there. The
//! engine may crash or hang on a damaged file, and its memory cannot be counted beforehand. So it is a process
//! with a limit of its memory and a timeout.

mod error;
mod process;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use std::{fs, iter};

pub use error::CadError;

use super::budget::Budget;
use super::report::WarningKind;
use super::{ImportOptions, Part, UpAxis, gltf};

/// The program that converts STEP and IGES.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Converter {
    /// The path of `trimaran-occt`; without one these formats are refused, with the way to get it.
    pub program: Option<PathBuf>,
    /// How long it may be silent before it is ended.
    pub timeout: Duration,
}

impl Default for Converter {
    /// No program, and half an hour: it says nothing while it parses a large file.
    fn default() -> Self {
        Self { program: None, timeout: Duration::from_mins(30) }
    }
}

/// A format of exact surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Kind {
    Step,
    Iges,
}

/// Converts a file and reads the result. `stem` is the name of parts that have none and are in nothing that
/// has one. `path` is where the file is on disk, if it is; `progress` gets percents.
pub(super) fn import(
    kind: Kind,
    stem: &str,
    path: Option<&Path>,
    bytes: &[u8],
    options: &ImportOptions,
    budget: &Budget,
    progress: &dyn Fn(u8),
) -> Result<Part, CadError> {
    let program = options.converter.program.as_ref().ok_or(CadError::NoConverter)?;
    let folder = tempfile::Builder::new().prefix("trimaran-").tempdir().map_err(CadError::Folder)?;
    let input = match path {
        Some(path) => path.to_owned(),
        None => {
            let input = folder.path().join("input");
            fs::write(&input, bytes).map_err(CadError::Folder)?;
            input
        }
    };
    let kind = match kind {
        Kind::Step => "step",
        Kind::Iges => "iges",
    };
    let up = match options.up {
        Some(UpAxis::Y) => "y",
        Some(UpAxis::Z) | None => "z",
    };
    let memory = options.limits.memory(bytes.len() as u64);
    let mut command = Command::new(program);
    command.arg(kind).arg(&input).arg(folder.path());
    command.args([&*options.chord_tolerance.to_string(), up, &*memory.to_string(), stem]);
    let mut unmeshed = Vec::new();
    process::run(&mut command, options.converter.timeout, memory, |line| {
        let mut words = line.splitn(3, ' ');
        let (word, number) = (words.next(), words.next().and_then(|number| number.parse::<u64>().ok()));
        match (word, number) {
            (Some("progress"), Some(percent)) => progress(percent.min(100) as u8),
            (Some("unmeshed"), Some(count)) => {
                unmeshed.push((count, words.next().unwrap_or_default().to_owned()));
            }
            _ => {}
        }
    })?;
    let made = fs::read(folder.path().join("model.glb")).map_err(CadError::Folder)?;
    let frame = ImportOptions { up: None, ..options.clone() };
    let mut part = gltf::import(None, &made, &frame, budget).map_err(Box::new)?;
    for (count, name) in unmeshed {
        part.report.warn_many(WarningKind::SurfaceUnmeshed, "", &name, count);
    }
    Ok(part)
}

/// The program beside this one, or else in a folder of `PATH`.
#[must_use]
pub fn find_converter(beside: Option<&Path>, path: Option<&std::ffi::OsStr>) -> Option<PathBuf> {
    let name = format!("trimaran-occt{}", std::env::consts::EXE_SUFFIX);
    let folders = path.into_iter().flat_map(std::env::split_paths);
    let beside = beside.and_then(Path::parent).map(Path::to_owned);
    iter::chain(beside, folders).map(|folder| folder.join(&name)).find(|program| program.is_file())
}
