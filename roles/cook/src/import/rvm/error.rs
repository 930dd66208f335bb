//! Why an RVM file could not be imported.

use std::{fmt, io};

use thiserror::Error;

use crate::import::OverBudget;

/// What is wrong with an RVM file, and where.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RvmError {
    /// The file or one of its chunks ends too early.
    #[error("it ends at {at}, in the middle of {what}; the file is cut off or damaged: get it again")]
    Truncated {
        /// Where.
        at: RvmPlace,
        /// What was being read.
        what: &'static str,
    },
    /// Something is not as the format demands.
    #[error("it is malformed at {at}: {what}; the file is damaged: get it again")]
    Malformed {
        /// Where.
        at: RvmPlace,
        /// What is wrong there.
        what: &'static str,
    },
    /// The system could not read it to its end.
    #[error("it cannot be read to its end: {0}; check the disk")]
    Read(#[from] io::Error),
    /// It asks for more than is allowed. A larger chord tolerance makes fewer triangles.
    #[error(transparent)]
    Budget(#[from] OverBudget),
}

/// A place in an RVM file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RvmPlace {
    /// A byte of the binary form, from 0 on.
    Byte(u64),
    /// A line of the text form, from 1 on.
    Line(u64),
}

impl fmt::Display for RvmPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Byte(byte) => write!(f, "byte {byte}"),
            Self::Line(line) => write!(f, "line {line}"),
        }
    }
}
