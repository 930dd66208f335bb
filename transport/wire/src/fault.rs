//! The faults of a message.

use thiserror::Error;

use crate::{BatchError, Kind, WireVersions};

/// The fault of a message.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DecodeFault {
    /// No message has this code.
    #[error("no message has the code {code:#04x}: this is not a Trimaran peer")]
    UnknownKind {
        /// The first byte of the header.
        code: u8,
    },
    /// The header claims a length that the kind does not allow.
    #[error("a message of kind {kind} cannot have {length} bytes, only {least} to {most}")]
    Length {
        /// The kind.
        kind: Kind,
        /// The length claimed.
        length: usize,
        /// The least that is allowed.
        least: usize,
        /// The most that is allowed.
        most: usize,
    },
    /// A hello without the magic number.
    #[error("the hello does not start with the magic number: this is not a Trimaran peer")]
    NotTrimaran,
    /// A hello or an accept of other versions.
    #[error("the peer speaks {theirs} of the protocol, this one {ours}: install the same release on both")]
    Version {
        /// The versions of this side.
        ours: WireVersions,
        /// The versions of the other.
        theirs: WireVersions,
    },
    /// A batch that is not a whole number of items.
    #[error("the batch is bad: {cause}")]
    Batch {
        /// The error.
        cause: BatchError,
    },
    /// A control message that postcard cannot read.
    #[error("the {kind} message is malformed: {cause}")]
    Control {
        /// The kind.
        kind: Kind,
        /// The error of postcard.
        cause: postcard::Error,
    },
    /// A control message with something behind it.
    #[error("the {kind} message has {bytes} bytes too many")]
    Trailing {
        /// The kind.
        kind: Kind,
        /// The number of bytes.
        bytes: usize,
    },
    /// A message that ends before its fixed part does.
    #[error("the {kind} message is too short")]
    Short {
        /// The kind.
        kind: Kind,
    },
}
