//! Output files of commands: a command overwrites only files of its own kind.

use std::{
    fs::{self, File},
    io::{self, Read},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use thiserror::Error;

/// Why a command does not write to a path.
#[derive(Debug, Error)]
pub(super) enum OutputError {
    /// It is one of the input files.
    #[error(
        "{path} is one of the files to be read, and would be lost: name another file to write to; after -o the \
         shell's first match is taken for it"
    )]
    Input { path: String },
    /// A file of another kind is there.
    #[error("{path} is there already and is no {kind}: name another file to write to, or move it away")]
    Foreign { path: String, kind: &'static str },
    /// It cannot be read.
    #[error("cannot look at {path}, which is to be written")]
    Unread { path: String, source: io::Error },
}

/// A kind of file that a command may write over.
pub(super) struct Kind {
    /// For messages.
    pub(super) name: &'static str,
    /// Whether a file's first bytes are of this kind.
    pub(super) begins: fn(&[u8]) -> bool,
}

/// Cooked scenes.
pub(super) const SCENE: Kind = Kind { name: "cooked scene", begins: trimaran_scene::looks_like_a_scene };
/// Pages of the report.
pub(super) const PAGE: Kind =
    Kind { name: "page of a report", begins: |bytes| bytes.starts_with(b"<!DOCTYPE html>") };
/// Notes for other programs.
pub(super) const BCF: Kind = Kind { name: "BCF file", begins: |bytes| bytes.starts_with(b"PK\x03\x04") };
/// Lists of clashes.
pub(super) const CLASHES: Kind = Kind {
    name: "list of clashes",
    begins: |bytes| bytes.starts_with(b"kind,distance_m") || bytes.starts_with(b"clashes,hard,"),
};
/// Traces of walks.
#[cfg(feature = "lab")]
pub(super) const TRACE: Kind = Kind { name: "trace", begins: trimaran::trace::looks_like_a_trace };

/// Pages of `trimaran audit`.
#[cfg(feature = "lab")]
pub(super) const AUDIT: Kind =
    Kind { name: "page of an audit", begins: |bytes| bytes.starts_with(b"# Where culling ") };

/// Enough first bytes to tell a file's kind.
const HEAD: u64 = 16;

/// Refuses to write to `path` if it holds a file of another kind, or is one of `inputs`. An empty file may be
/// overwritten: programs that make temporary names leave such files.
pub(super) fn check(path: &Path, kind: &Kind, inputs: &[PathBuf]) -> Result<(), OutputError> {
    let shown = || path.display().to_string();
    let unread = |source| OutputError::Unread { path: shown(), source };
    let there = match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        there => there.map_err(unread)?,
    };
    // Hard links and symbolic links to it are the same file.
    let is_it = |input: &PathBuf| {
        fs::metadata(input).is_ok_and(|input| (input.dev(), input.ino()) == (there.dev(), there.ino()))
    };
    if inputs.iter().any(is_it) {
        return Err(OutputError::Input { path: shown() });
    }
    let mut head = Vec::new();
    if there.is_file() {
        File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head)).map_err(unread)?;
    }
    if there.is_file() && (head.is_empty() || (kind.begins)(&head)) {
        return Ok(());
    }
    Err(OutputError::Foreign { path: shown(), kind: kind.name })
}
