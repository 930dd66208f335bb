//! Why a report could not be written, and the remedy.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why a report could not be written. An older one is still there, whole, unless the error is about `moving`.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A file or folder could not be read or written.
    #[error("{doing} {} failed{}", path.display(), advice(source))]
    Io {
        /// The failed action.
        doing: &'static str,
        /// Its file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// Another process writes into the same folder.
    #[error(
        "another process writes a report into {}; wait for its end, or give another folder with --out",
        path.display()
    )]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// A picture's bytes do not fill its size.
    #[error("the picture {} has another size than it says", path.display())]
    Picture {
        /// Its intended file.
        path: PathBuf,
    },
    /// A picture could not be encoded.
    #[error("encoding the picture {} failed", path.display())]
    Encode {
        /// Its intended file.
        path: PathBuf,
        /// The encoder's error.
        source: png::EncodingError,
    },
    /// A picture just written could not be read back for the page.
    #[error("reading the picture {} back failed; is something else writing there?", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// The decoder's error.
        source: png::DecodingError,
    },
    /// The report could not be made JSON.
    #[error("the report could not be written as JSON")]
    Json(#[from] serde_json::Error),
}

impl ReportError {
    /// Whether it may work another time with the same arguments: the disk is full, or the folder is in use.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Busy { .. } => true,
            Self::Io { source, .. } => {
                matches!(source.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
            }
            _ => false,
        }
    }
}

/// The remedy.
fn advice(source: &io::Error) -> &'static str {
    match source.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            ": no space left; free some, or give another folder with --out"
        }
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            ": not permitted; give a folder that you may write to with --out"
        }
        ErrorKind::NotADirectory | ErrorKind::AlreadyExists => {
            ": a file is in the way; give another folder with --out"
        }
        _ => "",
    }
}

/// Returns a function that makes a [`ReportError`] of the system's error.
pub(crate) fn io_error(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> ReportError + use<> {
    let path = path.to_owned();
    move |source| ReportError::Io { doing, path, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_says_what_to_do() {
        let full = ReportError::Io {
            doing: "writing",
            path: "out/report.json".into(),
            source: ErrorKind::StorageFull.into(),
        };
        assert_eq!(
            full.to_string(),
            "writing out/report.json failed: no space left; free some, or give another folder with --out"
        );
    }
}
