//! Why an RVM file could not be imported.

use std::io;

use thiserror::Error;

use crate::import::{FilePosition, OverBudget};

/// An error in an RVM file, and its place.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RvmError {
    /// The file or one of its chunks ends too early.
    #[error("it ends at {at}, in the middle of {what}; the file is cut off or damaged: get it again")]
    Truncated {
        /// The place.
        at: FilePosition,
        /// The item being read.
        what: &'static str,
    },
    /// The format is violated.
    #[error("it is malformed at {at}: {what}; the file is damaged: get it again")]
    Malformed {
        /// The place.
        at: FilePosition,
        /// The error.
        what: &'static str,
    },
    /// The system could not read it to its end.
    #[error("it cannot be read to its end: {0}; check the disk")]
    Read(#[from] io::Error),
    /// It exceeds a limit. A larger chord tolerance makes fewer triangles.
    #[error(transparent)]
    Budget(#[from] OverBudget),
}
