//! The scheme of each endpoint.

use std::io;
use std::sync::Arc;

use crate::scheme::Scheme;
use crate::stream::Streams;
use crate::{Endpoint, Options, Transport};

/// The scheme that makes links at `endpoint`. Each transport of this crate has its line here.
///
/// # Errors
/// If this build lacks the transport, or the options do not have it.
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
        #[cfg(feature = "ws")]
        Endpoint::Ws(at) => streams(Arc::new(crate::ws::WebSockets {
            at: at.clone(),
            tcp: options.tcp,
            options: options.ws.clone(),
        })),
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

/// The transport of this scheme among those of `options`.
fn named<'o>(options: &'o Options, scheme: &str) -> Option<&'o Arc<dyn Transport>> {
    options.transports.iter().find(|transport| transport.scheme() == scheme)
}
