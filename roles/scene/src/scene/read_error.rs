//! Why part of an open scene cannot be read.

use std::io;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use thiserror::Error;

use super::{GeometryError, SceneError};

/// Why part of an open scene cannot be read: the part, its place in the file, and the cause.
#[derive(Debug, Clone, Error)]
#[error(
    "the scene {} cannot be read at bytes {} to {} ({what}){}",
    self.name(), bytes.start, bytes.end, self.advice()
)]
pub struct ReadError {
    /// The file.
    pub path: PathBuf,
    /// Their offsets in the file.
    pub bytes: Range<u64>,
    /// Their content.
    pub what: String,
    /// The cause.
    #[source]
    pub cause: ReadCause,
}

/// The cause of a read error.
#[derive(Debug, Clone, Error)]
#[non_exhaustive]
pub enum ReadCause {
    /// The system cannot read it.
    #[error("the file cannot be read")]
    Io(#[source] Arc<io::Error>),
    /// The bytes have changed since they were written.
    #[error("it is damaged: its checksum does not match")]
    Damaged,
    /// The file was written to since it was opened.
    #[error("the file was overwritten while it was open")]
    Changed,
    /// A record breaks a rule of the format.
    #[error(transparent)]
    Malformed(#[from] SceneError),
    /// A piece of geometry cannot be unpacked.
    #[error("the geometry is malformed: {0}")]
    Geometry(#[from] GeometryError),
}

impl ReadError {
    /// The file's name alone: clients of a service see it, and must not learn its folder.
    fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or(self.path.as_os_str());
        format!("{name:?}")
    }

    fn advice(&self) -> &'static str {
        match self.cause {
            ReadCause::Io(_) => "",
            ReadCause::Damaged => "; copy it again, or import again",
            ReadCause::Changed => "; start again, and replace scenes by renaming a new file over the old one",
            ReadCause::Malformed(_) | ReadCause::Geometry(_) => {
                "; import again, and report this if it happens again"
            }
        }
    }
}
