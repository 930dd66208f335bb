//! How a handshake fails, whatever the transport.

use std::io;

use thiserror::Error;
use trimaran_proto::{DecodeError, Kind, Refusal};

use crate::error::{LaneError, Loss, ProtocolError};
use crate::unix::ForeignUser;

/// Why a handshake failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum HandshakeError {
    /// The other side closed the connection.
    #[error("the connection was closed during the handshake")]
    Closed,
    /// The system reports an error.
    #[error("the connection failed during the handshake")]
    Io(#[source] io::Error),
    /// What came is not this protocol.
    #[error("the other side does not speak this protocol")]
    Decode(#[from] DecodeError),
    /// A message came that is no part of a handshake.
    #[error("a {kind} message came during the handshake")]
    Unexpected {
        /// The message.
        kind: Kind,
    },
    /// The other side refuses.
    #[error("refused: {0}")]
    Refused(Refusal),
    /// It took too long.
    #[error("the handshake took too long")]
    TimedOut,
    /// The peer is another user's process.
    #[error(transparent)]
    ForeignUser(#[from] ForeignUser),
}

impl From<LaneError> for HandshakeError {
    fn from(error: LaneError) -> Self {
        match error {
            LaneError::Lost(Loss::Io(e)) => Self::Io(e),
            LaneError::Lost(Loss::Closed | Loss::Cut { .. }) => Self::Closed,
            LaneError::Protocol(ProtocolError::Decode(e)) => Self::Decode(e),
            LaneError::Protocol(ProtocolError::Misplaced { kind, .. }) => Self::Unexpected { kind },
            LaneError::Protocol(ProtocolError::Frame(_)) => Self::Unexpected { kind: Kind::Ids },
            LaneError::Goodbye(_) => Self::Unexpected { kind: Kind::Goodbye },
            LaneError::Expired(_) => Self::TimedOut,
        }
    }
}
