//! A transport of your own: whatever carries bytes in order.

use std::fmt;
use std::io;
use std::sync::Arc;

use thiserror::Error;
use trimaran_net::{BoxFuture, Listen, Net, Stream, StreamPeer};

use crate::Name;
use crate::handshake::HandshakeError;

/// A transport that carries bytes in order and without loss: the crate makes links of it, whose lanes have a
/// byte stream each. TCP and Unix sockets are such; give others to [`Options`](crate::Options).
///
/// What loses or reorders packets, as datagrams do, has lanes of its own inside this crate.
pub trait Transport: fmt::Debug + Send + Sync {
    /// The transport's name in endpoints: `tls` of `tls://host:443`, say. Letters, digits, `+`, `-` and `.`.
    fn scheme(&self) -> &'static str;

    /// Whether nobody on the way can read or change what travels.
    fn is_encrypted(&self) -> bool {
        false
    }

    /// Whether peers are on this machine.
    fn is_local(&self) -> bool {
        false
    }

    /// Opens a byte stream to whoever listens at `address`, the part of the endpoint behind its scheme.
    ///
    /// A link opens one for each of its four lanes: for all but the first one `beside` is the peer of the
    /// first, in case that the address has several.
    ///
    /// Dropping the future gives up.
    ///
    /// # Errors
    /// When there is none now. The link is tried again, except for [`io::ErrorKind::Unsupported`].
    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
        beside: Option<StreamPeer>,
    ) -> BoxFuture<'a, Result<Stream, AttemptError>>;

    /// Listens at `address`.
    ///
    /// # Errors
    /// When that is not possible.
    fn listen<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
    ) -> BoxFuture<'a, Result<Listening, ListenFault>>;

    /// What whoever connects and whoever listens say to each other before the bytes of a link begin, such as
    /// an HTTP upgrade: the part of the end that listens. The other part belongs to [`Transport::connect`].
    /// Default nothing.
    fn upgrade(&self) -> Option<&dyn Upgrade> {
        None
    }

    /// Whether this peer may come at all, as the transport knows it: asked before a handshake begins, at both
    /// ends.
    ///
    /// # Errors
    /// When it may not.
    fn admit(&self, _peer: StreamPeer) -> io::Result<()> {
        Ok(())
    }
}

/// What comes before the bytes of a link, at the end that listens.
pub trait Upgrade: Send + Sync {
    /// Does it on a stream that was accepted. It is part of the link's handshake, whose limits in time and
    /// number hold: where they are passed, the future is dropped, and the stream with it.
    ///
    /// # Errors
    /// When it fails, or the peer is not to be let in.
    fn upgrade(&self, stream: Stream) -> BoxFuture<'_, io::Result<Stream>>;
}

/// Transports are the same if their schemes are.
impl PartialEq for dyn Transport {
    fn eq(&self, other: &Self) -> bool {
        self.scheme() == other.scheme()
    }
}

/// What listens.
pub struct Listening {
    /// Gives the streams of those who connect.
    pub socket: Box<dyn Listen>,
    /// Where: the address with the port that was chosen, where it was to.
    pub address: String,
}

impl fmt::Debug for Listening {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Listening").field("address", &self.address).finish_non_exhaustive()
    }
}

/// Why nothing listens.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ListenFault {
    /// The host has no address now.
    #[error("the host has no address")]
    Address(#[source] io::Error),
    /// The system does not let it.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// What a link's transport promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capabilities {
    /// Every frame arrives complete, or the link ends.
    pub reliable: bool,
    /// Frames arrive in the order sent, none before all of the one before.
    pub ordered: bool,
    /// Nobody on the way can read or change what travels.
    pub encrypted: bool,
    /// The peer is on this machine.
    pub local: bool,
}

impl Capabilities {
    /// Those of a transport that carries bytes in order.
    pub(crate) fn over(transport: &dyn Transport) -> Self {
        let (encrypted, local) = (transport.is_encrypted(), transport.is_local());
        Self { reliable: true, ordered: true, encrypted, local }
    }
}

/// Why one attempt failed.
///
/// Most of it is a hint only. A name server, a router or whoever has the address for a moment can cause it,
/// and so can forged packets: [`connect`](crate::connect) tries again.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AttemptError {
    /// The host name has no address now.
    #[error("the host name could not be resolved")]
    Resolve(#[source] io::Error),
    /// The host name has no address at all.
    #[error("the host name has no address")]
    NoAddress,
    /// No connection.
    #[error("no connection to {address}")]
    Connect {
        /// Where to.
        address: String,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// A connection, but no handshake.
    #[error("no handshake with {address}")]
    Handshake {
        /// With whom.
        address: String,
        /// Why.
        #[source]
        cause: HandshakeError,
    },
    /// Nobody in this process listens under the name.
    #[error("nobody in this process listens as {name}")]
    Nobody {
        /// The name.
        name: Name,
    },
    /// The attempt itself took too long.
    #[error("no answer in time")]
    TimedOut,
}

impl AttemptError {
    /// Whether nobody said anything.
    pub(crate) const fn is_silence(&self) -> bool {
        matches!(self, Self::Handshake { cause: HandshakeError::Unanswered, .. })
    }

    /// Whether what this side was given is at fault, so that no other attempt can end differently. What a
    /// peer says never is.
    pub(crate) fn is_final(&self) -> bool {
        match self {
            Self::Handshake { cause, .. } => cause.is_final(),
            Self::Connect { cause, .. } => cause.kind() == io::ErrorKind::Unsupported,
            _ => false,
        }
    }

    /// Whether somebody answers who does not go together with this side.
    pub(crate) const fn is_mismatch(&self) -> bool {
        matches!(self, Self::Handshake { cause, .. } if cause.is_mismatch())
    }
}
