//! Custom transports: any carrier of bytes in order.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use thiserror::Error;
use trimaran_net::{BoxFuture, Listen, Net, Stream, StreamPeer};

use crate::Name;
use crate::handshake::HandshakeError;

/// A transport that carries bytes in order and without loss. The crate makes links of it, with a byte stream
/// for each lane. TCP and Unix sockets are such; give others to [`Options`](crate::Options).
///
/// A transport that loses or reorders packets is a [`LaneTransport`](crate::LaneTransport).
pub trait Transport: fmt::Debug + Send + Sync {
    /// The transport's name in endpoints, such as `tls` of `tls://host:443`: letters, digits, `+`, `-`, `.`.
    fn scheme(&self) -> &'static str;

    /// Whether traffic is encrypted and authenticated against anyone on the path.
    fn is_encrypted(&self) -> bool {
        false
    }

    /// Whether peers are on this machine.
    fn is_local(&self) -> bool {
        false
    }

    /// Opens a byte stream to the listener at `address`, the part of the endpoint behind its scheme.
    ///
    /// A link opens one for each of its four lanes, and for each channel. For all but the first one `beside`
    /// is the peer of the first, in case the address has several.
    ///
    /// Dropping the future ends the attempt.
    ///
    /// # Errors
    /// If there is none now. The link is tried again, except for [`io::ErrorKind::Unsupported`].
    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
        beside: Option<StreamPeer>,
    ) -> BoxFuture<'a, Result<Stream, AttemptError>>;

    /// Listens at `address`.
    ///
    /// # Errors
    /// If that is not possible.
    fn listen<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
    ) -> BoxFuture<'a, Result<Listening, ListenFault>>;

    /// The exchange before the bytes of a link, such as an HTTP upgrade: the listening end's part. The other
    /// part belongs to [`Transport::connect`]. Default nothing.
    fn upgrade(&self) -> Option<&dyn Upgrade> {
        None
    }

    /// Whether this peer may connect at all, as far as the transport knows. It is asked before a handshake,
    /// at both ends.
    ///
    /// # Errors
    /// If it may not.
    fn admit(&self, _peer: StreamPeer) -> io::Result<()> {
        Ok(())
    }
}

/// The exchange before the bytes of a link, at the listening end.
pub trait Upgrade: Send + Sync {
    /// Upgrades an accepted stream, as part of the link's handshake: its limits in time and number apply. If
    /// they are exceeded, the future and the stream are dropped.
    ///
    /// # Errors
    /// If it fails, or the peer is not admitted.
    fn upgrade(&self, stream: Stream) -> BoxFuture<'_, io::Result<Stream>>;
}

/// Transports are equal if their schemes are.
impl PartialEq for dyn Transport {
    fn eq(&self, other: &Self) -> bool {
        self.scheme() == other.scheme()
    }
}

/// A listening transport.
pub struct Listening {
    /// Accepts streams of connecting peers.
    pub socket: Box<dyn Listen>,
    /// The address, with the port that was chosen.
    pub address: String,
}

impl fmt::Debug for Listening {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Listening").field("address", &self.address).finish_non_exhaustive()
    }
}

/// Why listening failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ListenFault {
    /// The host has no address now.
    #[error("the host has no address")]
    Address(#[source] io::Error),
    /// The system refuses.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// The first address of a host and port.
///
/// # Errors
/// If it has none.
pub async fn first_address(net: &Arc<dyn Net>, at: &str) -> Result<SocketAddr, ListenFault> {
    let addresses = net.resolve(at).await.map_err(ListenFault::Address)?;
    addresses.first().copied().ok_or_else(|| ListenFault::Address(io::ErrorKind::NotFound.into()))
}

/// The guarantees of a link's transport.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capabilities {
    /// Every frame arrives complete, or the link ends.
    pub reliable: bool,
    /// Frames arrive in the order sent, each complete before the next one.
    pub ordered: bool,
    /// Nobody on the path can read or change the traffic.
    pub encrypted: bool,
    /// The peer is on this machine.
    pub local: bool,
}

impl Capabilities {
    /// The guarantees of a transport that carries bytes in order.
    pub(crate) fn over(transport: &dyn Transport) -> Self {
        let (encrypted, local) = (transport.is_encrypted(), transport.is_local());
        Self { reliable: true, ordered: true, encrypted, local }
    }
}

/// Why one attempt failed.
///
/// Most errors are only a hint. A name server, a router, a temporary holder of the address or forged packets
/// can cause them: [`connect`](crate::connect) tries again.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AttemptError {
    /// The host name has no address now.
    #[error("the host name could not be resolved")]
    Resolve(#[source] io::Error),
    /// The host name has no address at all.
    #[error("the host name has no address")]
    NoAddress,
    /// No connection could be made.
    #[error("no connection to {address}")]
    Connect {
        /// The address.
        address: String,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// A connection was made, but the handshake failed.
    #[error("no handshake with {address}")]
    Handshake {
        /// The address.
        address: String,
        /// The cause.
        #[source]
        cause: HandshakeError,
    },
    /// No listener in this process has the name.
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
    /// Whether there was no answer at all.
    pub(crate) const fn is_silence(&self) -> bool {
        matches!(self, Self::Handshake { cause: HandshakeError::Unanswered, .. })
    }

    /// Whether this side's own settings are at fault, so that no other attempt can end differently. The
    /// peer's messages never count as that.
    pub(crate) fn is_final(&self) -> bool {
        match self {
            Self::Handshake { cause, .. } => cause.is_final(),
            Self::Connect { cause, .. } => cause.kind() == io::ErrorKind::Unsupported,
            _ => false,
        }
    }

    /// Whether the answering peer does not fit this side.
    pub(crate) const fn is_mismatch(&self) -> bool {
        matches!(self, Self::Handshake { cause, .. } if cause.is_mismatch())
    }
}
