//! Listening for peers.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use tokio::sync::mpsc;
use trimaran_proto::Identity;

use super::desk::Desk;
use super::handshake::HandshakeError;
use super::options::Options;
use crate::Link;
use crate::net::{Instant, Net, until};

/// How many links may wait for [`Listener::accept`].
const QUEUE: usize = 8;

/// Why a listener could not be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ListenError {
    /// The address is none, or not of this machine.
    #[error("cannot listen on {address:?}: it is not an address of the form host:port of this machine")]
    Address {
        /// What was given.
        address: String,
        /// What the resolver says.
        #[source]
        cause: io::Error,
    },
    /// Someone else listens there.
    #[error(
        "cannot listen on {address}: another program has the port; choose another one, or stop that program"
    )]
    InUse {
        /// Where.
        address: SocketAddr,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// Any other failure.
    #[error("cannot listen on {address}")]
    Io {
        /// Where.
        address: SocketAddr,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
}

/// Why no peer was accepted.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AcceptError {
    /// No peer came before the deadline.
    #[error("no peer connected to {address} in {waited:?}{}", .last.as_ref().map(|e| format!(" (the last that tried: {e})")).unwrap_or_default())]
    Deadline {
        /// Where we listened.
        address: SocketAddr,
        /// How long this call waited.
        waited: Duration,
        /// What became of the last connection that did not make it to a link.
        #[source]
        last: Option<HandshakeError>,
    },
    /// The listener's task is gone, because its runtime was shut down.
    #[error("the listener on {address} was shut down")]
    ShutDown {
        /// Where we listened.
        address: SocketAddr,
    },
}

/// Takes peers that connect.
///
/// Handshakes go on beside the caller: a stranger, or a peer that stops in the middle, holds up nobody. Each has a limit in
/// time and they have one in number.
#[derive(Debug)]
pub struct Listener {
    links: mpsc::Receiver<Link>,
    address: SocketAddr,
    net: Arc<dyn Net>,
    desk: Arc<Desk>,
}

impl Listener {
    /// Listens on `address` (`host:port`, port 0 takes a free one) as the peer `identity`.
    ///
    /// # Errors
    /// When the address cannot be listened on.
    pub async fn bind(
        net: &Arc<dyn Net>,
        address: &str,
        identity: Identity,
        options: &Options,
    ) -> Result<Self, ListenError> {
        let named = |cause| ListenError::Address { address: address.to_owned(), cause };
        let at = net.resolve(address).await.map_err(named)?;
        let at = at.first().copied().ok_or_else(|| named(io::ErrorKind::NotFound.into()))?;
        let failed = |cause: io::Error| match cause.kind() {
            io::ErrorKind::AddrInUse => ListenError::InUse { address: at, cause },
            _ => ListenError::Io { address: at, cause },
        };
        let socket = net.listen_tcp(at, options.tcp).map_err(failed)?;
        let address = socket.local_addr().map_err(failed)?;
        let (done, links) = mpsc::channel(QUEUE);
        let desk = Arc::new(Desk::new(net, identity, *options, done));
        net.spawn(Box::pin(Arc::clone(&desk).serve(socket)));
        Ok(Self { links, address, net: Arc::clone(net), desk })
    }

    /// Where it listens.
    #[must_use]
    pub const fn local_addr(&self) -> SocketAddr {
        self.address
    }

    /// Waits for the next peer, until `deadline` at most.
    ///
    /// # Errors
    /// When none came; then the error says what became of the last one that tried.
    pub async fn accept(&mut self, deadline: Instant) -> Result<Link, AcceptError> {
        let started = self.net.now();
        let address = self.address;
        match until(&*self.net, deadline, self.links.recv()).await {
            Some(Some(link)) => Ok(link),
            Some(None) => Err(AcceptError::ShutDown { address }),
            None => {
                let waited = self.net.now().since(started);
                let last = self.desk.last_failure();
                Err(AcceptError::Deadline { address, waited, last })
            }
        }
    }
}
