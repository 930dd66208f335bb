//! Why a file is not opened as a scene.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::{ReadCause, ReadError};

/// Why a file is not opened as a scene.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The file cannot be read.
    #[error("cannot read the scene {path:?}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file is of another kind.
    #[error("{path:?} is not a cooked scene; make one with `trimaran import`")]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// The file has another version of the format.
    #[error("the scene {path:?} has format {found}, this build reads format {known}; {}", other_version_advice(*found, *known))]
    Version {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
        /// The format this build reads.
        known: u32,
    },
    /// The file ends early: it is still being copied, or the copy broke off.
    #[error(
        "the scene {path:?} is cut short: {actual} of {expected} bytes; wait if it is being copied, \
         else copy it again, or import again"
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// The length it should have.
        expected: u64,
        /// The length it has.
        actual: u64,
    },
    /// The file was written to while it was read, so the result is not a scene.
    #[error(
        "the scene {path:?} changed while it was read: {source}; wait until it is written, then try again"
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// The error in the data read.
        source: Box<Self>,
    },
    /// The file's bytes have changed since they were written.
    #[error("the scene {path:?} is damaged ({what}); copy it again, or import again")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The failed check.
        what: &'static str,
    },
    /// The top of its tree cannot be read.
    #[error(transparent)]
    Read(ReadError),
}

impl OpenError {
    /// Whether the same file may open a little later without a repair: it does not exist yet, is still being
    /// copied (cut short), or changed while it was read.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Truncated { .. } | Self::Changed { .. } => true,
            Self::Read(error) => matches!(error.cause, ReadCause::Changed),
            Self::Io { source, .. } => {
                matches!(source.kind(), io::ErrorKind::NotFound | io::ErrorKind::StaleNetworkFileHandle)
            }
            _ => false,
        }
    }

    /// The same error for a file that was written to meanwhile. Unchanged if it says so already.
    pub(super) fn while_changing(self, path: &Path) -> Self {
        match self {
            Self::Foreign { .. } | Self::Version { .. } | Self::Damaged { .. } => {
                Self::Changed { path: path.to_owned(), source: Box::new(self) }
            }
            _ => self,
        }
    }
}

fn other_version_advice(found: u32, known: u32) -> &'static str {
    if found > known {
        "use a newer build, or import again with this one"
    } else {
        "import again with this build"
    }
}
