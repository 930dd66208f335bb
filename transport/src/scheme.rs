//! Schemes: how links are made at an endpoint.

#[cfg(any(feature = "tcp", feature = "quic", feature = "udp"))]
use std::net::SocketAddr;
use std::sync::Arc;

#[cfg(feature = "udp")]
use trimaran_net::Instant;
use trimaran_net::{BoxFuture, Net};
use trimaran_wire::SessionId;

use crate::acceptor::Acceptor;
use crate::application::Application;
use crate::parts::Parts;
use crate::transport::{AttemptError, ListenFault};
use crate::{Endpoint, Options};

/// Makes links at one endpoint.
pub(crate) trait Scheme: Send + Sync {
    /// Tries once to make a link with the listener at the endpoint.
    fn attempt<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<Parts, AttemptError>>;

    /// Listens there, and receives peers until nobody accepts any more.
    fn listen<'a>(&'a self, acceptor: &'a Arc<Acceptor>) -> BoxFuture<'a, Result<Listened, ListenFault>>;
}

/// This side's introduction in one attempt.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Introduction<'o> {
    pub(crate) application: &'o dyn Application,
    pub(crate) session: SessionId,
    pub(crate) options: &'o Options,
    /// When the attempt is cut short.
    #[cfg(feature = "udp")]
    pub(crate) by: Instant,
}

/// A listener that is up.
pub(crate) struct Listened {
    /// Its endpoint, with the chosen port.
    pub(crate) at: Endpoint,
    /// Dropped with the listener.
    pub(crate) guard: Option<Box<dyn Send + Sync>>,
}

impl From<Endpoint> for Listened {
    fn from(at: Endpoint) -> Self {
        Self { at, guard: None }
    }
}

/// The first address of a host and port.
#[cfg(any(feature = "tcp", feature = "quic", feature = "udp"))]
pub(crate) async fn first_address(net: &Arc<dyn Net>, at: &str) -> Result<SocketAddr, ListenFault> {
    let addresses = net.resolve(at).await.map_err(ListenFault::Address)?;
    addresses.first().copied().ok_or_else(|| ListenFault::Address(std::io::ErrorKind::NotFound.into()))
}
