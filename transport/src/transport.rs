//! A transport of your own: whatever carries bytes in order.

use std::fmt;
use std::io;
use std::sync::Arc;

use trimaran_net::{BoxFuture, Listen, Net, Stream, StreamPeer};

use crate::{AttemptError, Options};

/// A transport that carries bytes in order and without loss: the crate makes links of it, whose lanes have a
/// byte stream each. TCP and Unix sockets are such; give others to [`Options::transports`].
///
/// What loses or reorders packets, as datagrams do, has lanes of its own inside this crate.
pub trait Transport: fmt::Debug + Send + Sync {
    /// The transport's name in endpoints: `ws` of `ws://host:80`, say. Letters, digits, `+`, `-` and `.`.
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
    /// A link opens one for each of its three lanes: for all but the first one `beside` is the peer of the first,
    /// in case that the address has several.
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

    /// Whether this peer may come at all, as the transport knows it: asked before a handshake begins, at both
    /// ends.
    ///
    /// # Errors
    /// When it may not.
    fn admit(&self, _peer: StreamPeer) -> io::Result<()> {
        Ok(())
    }
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
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ListenFault {
    /// The host has no address now.
    #[error("the host has no address")]
    Address(#[source] io::Error),
    /// The system does not let it.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// The transport of this scheme among those of `options`.
pub(crate) fn named<'o>(options: &'o Options, scheme: &str) -> Option<&'o Arc<dyn Transport>> {
    options.transports.iter().find(|transport| transport.scheme() == scheme)
}
