//! What makes links at an endpoint: one for each scheme.

use std::io;
#[cfg(any(feature = "tcp", feature = "quic", feature = "udp"))]
use std::net::SocketAddr;
use std::sync::Arc;

use trimaran_net::{BoxFuture, Net};

use crate::acceptor::Acceptor;
use crate::connect::{AttemptError, Introduction};
use crate::link::Parts;
use crate::stream::Streams;
use crate::transport::{ListenFault, named};
use crate::{Endpoint, Options};

/// Makes links at one endpoint.
pub(crate) trait Scheme: Send + Sync {
    /// Tries once to make a link with whoever listens there.
    fn attempt<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<Parts, AttemptError>>;

    /// Listens there, and receives peers until nobody accepts them any more.
    fn listen<'a>(&'a self, acceptor: &'a Arc<Acceptor>) -> BoxFuture<'a, Result<Listened, ListenFault>>;
}

/// Somebody listens.
pub(crate) struct Listened {
    /// Where, with the port that was chosen.
    pub(crate) at: Endpoint,
    /// To be dropped with the listener.
    pub(crate) guard: Option<Box<dyn Send + Sync>>,
}

impl From<Endpoint> for Listened {
    fn from(at: Endpoint) -> Self {
        Self { at, guard: None }
    }
}

/// What makes links at `endpoint`. Each transport of this crate has its line here.
///
/// # Errors
/// When it is built without that transport, or nobody has given it.
pub(crate) fn scheme_of(endpoint: &Endpoint, options: &Options) -> io::Result<Box<dyn Scheme>> {
    let streams = |transport| Box::new(Streams { transport, endpoint: endpoint.clone() });
    Ok(match endpoint {
        #[cfg(feature = "tcp")]
        Endpoint::Tcp(_) => streams(Arc::new(crate::tcp::Tcp(options.tcp))),
        #[cfg(feature = "unix")]
        Endpoint::Unix(_) => streams(Arc::new(crate::unix::Unix(options.unix.clone()))),
        #[cfg(feature = "quic")]
        Endpoint::Quic(at) => Box::new(crate::quic::Quic(at.clone())),
        #[cfg(feature = "udp")]
        Endpoint::Udp(at) => Box::new(crate::udp::Udp(at.clone())),
        #[cfg(feature = "inproc")]
        Endpoint::Inproc(name) => Box::new(crate::inproc::Inproc(name.clone())),
        other => {
            let transport = named(options, other.transport()).ok_or_else(|| {
                let why = format!(
                    "there is no transport {} here: build with its feature, or add it to the options' transports",
                    other.transport()
                );
                io::Error::new(io::ErrorKind::Unsupported, why)
            })?;
            streams(Arc::clone(transport))
        }
    })
}

/// The first address of a host and port.
#[cfg(any(feature = "tcp", feature = "quic", feature = "udp"))]
pub(crate) async fn first_address(net: &Arc<dyn Net>, at: &str) -> Result<SocketAddr, ListenFault> {
    let addresses = net.resolve(at).await.map_err(ListenFault::Address)?;
    addresses.first().copied().ok_or_else(|| ListenFault::Address(io::ErrorKind::NotFound.into()))
}
