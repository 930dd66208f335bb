//! Why an RVM file could not be imported.

use thiserror::Error;

use crate::import::OverBudget;

/// What is wrong with an RVM file, at which byte, and in which group.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RvmError {
    /// The file or one of its chunks ends too early.
    #[error(
        "it ends at byte {offset}, in the middle of {what}; the file is cut off or damaged: get it again"
    )]
    Truncated {
        /// Byte in the file.
        offset: usize,
        /// What was being read.
        what: &'static str,
    },
    /// Something is not as the format demands.
    #[error("it is malformed at byte {offset}: {what}; the file is damaged: get it again")]
    Malformed {
        /// Byte in the file.
        offset: usize,
        /// What is wrong there.
        what: &'static str,
    },
    /// A chunk of an unknown kind.
    #[error(
        "the chunk at byte {offset} is of the unknown kind {id:?}; the file is damaged, or newer than this reader"
    )]
    UnknownChunk {
        /// Byte in the file.
        offset: usize,
        /// The four letters of its kind.
        id: String,
    },
    /// A primitive of an unknown kind.
    #[error(
        "the primitive at byte {offset} in group {group:?} is of the unknown kind {kind}; kinds are 1 to 11"
    )]
    UnknownPrimitive {
        /// Byte in the file.
        offset: usize,
        /// Name of the group that holds it.
        group: String,
        /// Its kind.
        kind: u32,
    },
    /// A primitive's place or size is not a number.
    #[error(
        "the primitive at byte {offset} in group {group:?} is unusable: {what}; repair the model where it was made"
    )]
    Unusable {
        /// Byte in the file.
        offset: usize,
        /// Name of the group that holds it.
        group: String,
        /// What is wrong with it.
        what: &'static str,
    },
    /// It asks for more than is allowed. A larger chord tolerance makes fewer triangles.
    #[error(transparent)]
    Budget(#[from] OverBudget),
}
