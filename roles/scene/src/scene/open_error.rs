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
        /// What the system says.
        source: io::Error,
    },
    /// The file is something else.
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
    /// The file was written to while it was read, and what was read is no scene.
    #[error(
        "the scene {path:?} changed while it was read: {source}; wait until it is written, then try again"
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// What was wrong with what was read.
        source: Box<Self>,
    },
    /// The file's bytes are not those that were written.
    #[error("the scene {path:?} is damaged ({what}); copy it again, or import again")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Which check failed.
        what: &'static str,
    },
    /// The top of its tree cannot be read.
    #[error(transparent)]
    Read(ReadError),
}

impl OpenError {
    /// Whether the same file may open a little later with nobody mending anything: it is not there yet, is
    /// still being copied (cut short), or changed while it was read. Everything else stays as it is until
    /// somebody acts.
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

    /// The same error of a file that was written to meanwhile. Where it says so already, it stays as it is.
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
