//! Errors of a link.

use std::io;
use std::time::Duration;

use thiserror::Error;
use trimaran_wire::{
    BatchError, CloseReason, CodingError, DecodeError, FrameOrderError, FrameViolation, Kind, Lane,
    MAX_MESSAGE,
};

use crate::peer::PeerName;
use crate::rates::TooMany;
use crate::timeouts::{Expired, Unheard};

/// Why nothing was received.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecvError {
    /// The peer closed the link.
    #[error("{peer} closed the link: {reason}")]
    Closed {
        /// The peer.
        peer: PeerName,
        /// Its reason.
        reason: CloseReason,
    },
    /// The connection ended without a close: the peer crashed, was killed, or cannot be reached.
    #[error("the connection to {peer} was lost")]
    Lost {
        /// The peer.
        peer: PeerName,
        /// The cause.
        #[source]
        cause: Loss,
    },
    /// The deadline of this call came. The link stays usable.
    #[error("nothing came from {peer} before the deadline")]
    Deadline {
        /// The peer.
        peer: PeerName,
    },
    /// The peer broke the protocol. The link cannot be used any more.
    #[error("{peer} broke the protocol")]
    Protocol {
        /// The peer.
        peer: PeerName,
        /// The violation.
        #[source]
        cause: ProtocolError,
    },
}

/// Why something could not be sent.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SendError {
    /// The connection is gone. Receiving tells whether the peer closed the link before.
    #[error("the connection to {peer} was lost")]
    Lost {
        /// The peer.
        peer: PeerName,
        /// The cause.
        #[source]
        cause: Loss,
    },
    /// The peer took nothing within the link's timeout.
    #[error(
        "{peer} took nothing for {waited:?}: it hangs, or the link's timeout is too short for what it does"
    )]
    Stalled {
        /// The peer.
        peer: PeerName,
        /// The link's timeout.
        waited: Duration,
    },
    /// A message of the messages lane is too long.
    #[error("a message for {peer} is longer than {MAX_MESSAGE} bytes")]
    TooLong {
        /// The peer.
        peer: PeerName,
    },
    /// This side called begin, push and finish in the wrong order.
    #[error("a frame for {peer} was put together in the wrong order")]
    Order {
        /// The peer.
        peer: PeerName,
        /// The mistake.
        #[source]
        cause: FrameOrderError,
    },
}

/// How a connection ended without a close.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Loss {
    /// The peer closed it, between two messages.
    #[error("it was closed without a close")]
    Closed,
    /// The peer closed it within a message.
    #[error("it was closed in the middle of a message, {bytes} bytes into it")]
    Cut {
        /// The bytes of the message that had come.
        bytes: usize,
    },
    /// Nothing came within the idle timeout, not even a keep-alive.
    #[error(
        "no keep-alive came from it within the idle_timeout: its machine, its process or the way to it is gone or hangs"
    )]
    Silent,
    /// The system reports an error.
    #[error(transparent)]
    Io(io::Error),
}

/// A violation of the protocol by a peer.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ProtocolError {
    /// It sent bytes that are not a message.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// It broke the order of a frame, or announced other items.
    #[error(transparent)]
    Frame(#[from] FrameViolation),
    /// It broke the rules of the datagrams.
    #[cfg(feature = "udp")]
    #[error(transparent)]
    Datagrams(Box<trimaran_udp::Closed>),
    /// It sent a coded batch that the application cannot read.
    #[error(transparent)]
    Coded(CodingError),
    /// It sent a coded batch, and the application has no coding.
    #[error("a coded batch came, and this protocol has none")]
    NotCoded,
    /// It sent a batch that is not a whole number of items.
    #[error(transparent)]
    Batch(BatchError),
    /// It sent an invalid value.
    #[error("it sent a value that is none")]
    Value(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// It sent a message that the application does not have.
    #[error("it sent a message that is none of the application's")]
    Message(#[source] postcard::Error),
    /// It sent more than it may.
    #[error(transparent)]
    TooMany(#[from] TooMany),
    /// It sent a message on the wrong lane.
    #[error("a {kind} message does not belong on the {lane} lane")]
    Misplaced {
        /// The message.
        kind: Kind,
        /// The lane.
        lane: Lane,
    },
}

/// Why nothing comes from a lane, before its link names the peer.
#[derive(Debug)]
pub enum LaneError {
    /// The peer closed the lane.
    Closed(CloseReason),
    /// The connection ended without a close.
    Lost(Loss),
    /// The peer broke the protocol.
    Protocol(ProtocolError),
}

impl LaneError {
    pub(crate) fn receiving(self, peer: &PeerName) -> RecvError {
        let peer = peer.clone();
        match self {
            Self::Closed(reason) => RecvError::Closed { peer, reason },
            Self::Lost(cause) => RecvError::Lost { peer, cause },
            Self::Protocol(cause) => RecvError::Protocol { peer, cause },
        }
    }
}

impl Unheard {
    pub(crate) fn receiving(self, peer: &PeerName) -> RecvError {
        let peer = peer.clone();
        match self {
            Self::Deadline => RecvError::Deadline { peer },
            Self::Idle => RecvError::Lost { peer, cause: Loss::Silent },
        }
    }
}

impl Expired {
    pub(crate) fn sending(self, peer: &PeerName, timeout: Duration) -> SendError {
        let peer = peer.clone();
        match self {
            Self::Idle => SendError::Lost { peer, cause: Loss::Silent },
            Self::Timeout => SendError::Stalled { peer, waited: timeout },
        }
    }
}

/// A measured time for people: to the millisecond.
pub(crate) fn readable(measured: &Duration) -> Duration {
    Duration::from_millis(measured.as_millis().try_into().unwrap_or(u64::MAX))
}

/// The error for a message on the wrong lane.
pub(crate) const fn misplaced(kind: Kind, lane: Lane) -> LaneError {
    LaneError::Protocol(ProtocolError::Misplaced { kind, lane })
}
