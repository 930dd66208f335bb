//! Handshakes of every transport, and how they fail.

use std::io;

use thiserror::Error;
use trimaran_wire::{
    Accept, CloseReason, DecodeError, DecodeFault, Hello, Kind, MAX_HELLO, Message, ProtocolName, Refusal,
};

use crate::error::{LaneError, Loss, ProtocolError};
#[cfg(feature = "keys")]
use crate::keys::{Fingerprint, KeyFault, UnknownPeer, WrongRole};
use crate::rates::TooMany;

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
    /// The received bytes are not this protocol.
    #[error("the other side does not speak this protocol")]
    Decode(#[from] DecodeError),
    /// A message came that does not belong in a handshake.
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
    /// This side has no keys.
    #[error(
        "this transport needs keys: `Options::security` takes this peer's, and the public ones of its peers"
    )]
    NoKeys,
    /// This side's keys have none for QUIC.
    #[cfg(feature = "keys")]
    #[error("these keys are for datagrams alone: QUIC needs keys made by a program with the feature `quic`")]
    NoQuicKey,
    /// Nobody answers.
    #[error("no answer: nobody listens there, or not to these keys")]
    Unanswered,
    /// A peer came with keys that do not fit.
    #[error("someone came whose keys do not fit")]
    Stranger,
    /// No answer came in this version of the datagrams, but a claim that the other side has another one.
    #[error(
        "no answer in version {ours} of the datagrams, but a claim that the other side has version {theirs}: if both sides have different releases, install the same on both"
    )]
    Datagram {
        /// The claimed version: anyone on the path can claim one.
        theirs: u64,
        /// This side's version.
        ours: u64,
    },
    /// TLS cannot be set up.
    #[error("TLS cannot be set up")]
    Tls(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// This side does not know the peer's certificate.
    #[cfg(feature = "keys")]
    #[error(transparent)]
    UnknownPeer(#[from] Box<UnknownPeer>),
    /// The peer's key is known for another role than the claimed one.
    #[cfg(feature = "keys")]
    #[error(transparent)]
    WrongRole(#[from] Box<WrongRole>),
    /// The peer does not know this side's certificate.
    #[cfg(feature = "keys")]
    #[error(
        "the peer does not expect our certificate {presented}: add it to the peer's list, or use the keys it expects"
    )]
    NotKnown {
        /// The certificate that this side showed.
        presented: Fingerprint,
    },
    /// The other side speaks QUIC, but none of our protocols or versions.
    #[error("the other side speaks QUIC, but not {0}: install the same release on both")]
    Alpn(ProtocolName),
    /// This side's hello is too long.
    #[error(transparent)]
    HelloTooLong(#[from] HelloTooLong),
    /// The other side's hello cannot be read.
    #[error("the other side's hello cannot be read: install the same release on both")]
    Hello(#[source] postcard::Error),
    /// Values of the latest lane do not fit into the datagrams of the connection.
    #[error("values of the latest lane need datagrams of {needed} bytes, and the connection allows {}", .allowed.map_or("none".to_owned(), |n| n.to_string()))]
    Datagrams {
        /// The bytes that a value needs.
        needed: usize,
        /// The bytes that the peer and the path allow.
        allowed: Option<usize>,
    },
    /// The protocol has channels, and the transport has none, or fewer.
    #[error(
        "the protocol has {needed} channels, and a link over {scheme} has {most} at most: take another \
         transport"
    )]
    NoChannels {
        /// The transport.
        scheme: &'static str,
        /// The channels of the protocol.
        needed: usize,
        /// Those that the transport can have.
        most: usize,
    },
    /// Too many handshakes begin.
    #[error(transparent)]
    TooMany(#[from] TooMany),
    /// The transport does not admit the peer, for instance because it is another user's process.
    #[error("the peer is not let in")]
    NotLetIn(#[source] io::Error),
}

/// A hello of more than [`MAX_HELLO`] bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a hello of {0} bytes is longer than {MAX_HELLO}")]
pub struct HelloTooLong(pub(crate) usize);

impl HandshakeError {
    /// The refusal to send to the peer, if any.
    #[must_use]
    pub fn refusal(&self) -> Option<Refusal> {
        match self {
            Self::Refused(refusal) => Some(refusal.clone()),
            #[cfg(feature = "keys")]
            Self::WrongRole(claim) => Some(claim.refusal()),
            _ => None,
        }
    }

    /// The close for a peer whose key is known for another role, if it is one.
    pub(crate) fn wrong_role(&self) -> Option<CloseReason> {
        match self {
            #[cfg(feature = "keys")]
            Self::WrongRole(claim) => Some(claim.close()),
            _ => None,
        }
    }

    /// Whether this side's own settings are at fault.
    pub(crate) const fn is_final(&self) -> bool {
        match self {
            Self::HelloTooLong(_) | Self::NoKeys | Self::Tls(_) | Self::NoChannels { .. } => true,
            #[cfg(feature = "keys")]
            Self::NoQuicKey => true,
            _ => false,
        }
    }

    /// Whether the two sides do not fit, which a person has to fix: their keys, releases, data, settings or
    /// programs differ. Otherwise one of them is absent or has no room.
    pub(crate) const fn is_mismatch(&self) -> bool {
        match self {
            Self::Refused(refusal) => !refusal.is_passing(),
            Self::Closed | Self::Io(_) | Self::TimedOut | Self::Unanswered | Self::TooMany(_) => false,
            _ => true,
        }
    }
}

#[cfg(feature = "keys")]
impl From<KeyFault> for HandshakeError {
    fn from(fault: KeyFault) -> Self {
        match fault {
            KeyFault::Stranger => Self::Stranger,
            KeyFault::WrongRole(wrong) => Self::WrongRole(wrong),
        }
    }
}

impl From<LaneError> for HandshakeError {
    fn from(error: LaneError) -> Self {
        match error {
            LaneError::Lost(Loss::Io(e)) => Self::Io(e),
            LaneError::Lost(Loss::Closed | Loss::Cut { .. }) => Self::Closed,
            LaneError::Lost(Loss::Silent) => Self::TimedOut,
            LaneError::Protocol(ProtocolError::Decode(e)) => Self::Decode(e),
            LaneError::Protocol(ProtocolError::Misplaced { kind, .. }) => Self::Unexpected { kind },
            LaneError::Protocol(ProtocolError::TooMany(e)) => Self::TooMany(e),
            // A message that belongs on a lane.
            LaneError::Protocol(_) => Self::Unexpected { kind: Kind::Batch },
            LaneError::Closed(_) => Self::Unexpected { kind: Kind::Close },
        }
    }
}

/// The other side during the handshake.
pub(crate) trait Handshake: Send {
    /// Reads the next message.
    fn recv(&mut self) -> impl Future<Output = Result<Message, HandshakeError>> + Send;

    /// Sends the refusal and ends the stream.
    fn dismiss(&mut self, refusal: Refusal) -> impl Future<Output = Result<(), HandshakeError>> + Send;

    /// Refuses, and returns the error of the handshake, even if the other side can no longer be told.
    fn refuse(&mut self, refusal: Refusal) -> impl Future<Output = HandshakeError> + Send {
        async move {
            let _untold = self.dismiss(refusal.clone()).await;
            HandshakeError::Refused(refusal)
        }
    }

    /// Reads the hello of the connecting peer. A peer without a version in common is refused here, because
    /// its hello cannot be read further.
    fn recv_hello(&mut self) -> impl Future<Output = Result<Hello, HandshakeError>> + Send {
        async {
            match self.recv().await {
                Ok(Message::Hello(hello)) => Ok(hello),
                Ok(other) => Err(HandshakeError::Unexpected { kind: other.kind() }),
                Err(HandshakeError::Decode(e)) => {
                    if let DecodeFault::Version { ours, theirs } = e.fault {
                        let refusal = Refusal::Version { listener: ours, connector: theirs };
                        return Err(self.refuse(refusal).await);
                    }
                    Err(HandshakeError::Decode(e))
                }
                Err(e) => Err(e),
            }
        }
    }

    /// Reads the answer to a hello.
    fn recv_answer(&mut self) -> impl Future<Output = Result<Accept, HandshakeError>> + Send {
        async {
            match self.recv().await? {
                Message::Accept(accept) => Ok(accept),
                Message::Refuse(refusal) => Err(HandshakeError::Refused(refusal)),
                other => Err(HandshakeError::Unexpected { kind: other.kind() }),
            }
        }
    }
}
