//! The transport of each endpoint.

use std::io;
use std::sync::Arc;

use crate::stream::Streams;
use crate::{Endpoint, LaneTransport, Options, Transport};

/// The transport that makes links at `endpoint`. Each one of this crate has its line here.
///
/// # Errors
/// If this build lacks the transport, or the options do not have it.
pub(crate) fn transport_of(endpoint: &Endpoint, options: &Options) -> io::Result<Arc<dyn LaneTransport>> {
    Ok(match endpoint {
        #[cfg(feature = "tcp")]
        Endpoint::Tcp(_) => streams(Arc::new(crate::tcp::Tcp(options.tcp))),
        #[cfg(feature = "unix")]
        Endpoint::Unix(_) => streams(Arc::new(crate::unix::Unix(options.unix.clone()))),
        #[cfg(feature = "ws")]
        Endpoint::Ws(at) | Endpoint::Wss(at) => streams(Arc::new(crate::ws::WebSockets {
            at: at.clone(),
            is_encrypted: matches!(endpoint, Endpoint::Wss(_)),
            tcp: options.tcp,
            options: options.ws.clone(),
        })),
        #[cfg(feature = "quic")]
        Endpoint::Quic(_) => {
            Arc::new(crate::quic::Quic { options: options.quic, security: options.security.clone() })
        }
        #[cfg(feature = "udp")]
        Endpoint::Udp(at) => Arc::new(crate::udp::Udp {
            at: at.clone(),
            options: options.udp.clone(),
            security: options.security.clone(),
        }),
        #[cfg(feature = "inproc")]
        Endpoint::Inproc(name) => Arc::new(crate::inproc::Inproc(name.clone())),
        other => from_outside(other.transport(), options)?,
    })
}

/// Lanes over the byte streams of a transport.
fn streams(transport: Arc<dyn Transport>) -> Arc<dyn LaneTransport> {
    Arc::new(Streams(transport))
}

/// The transport of this scheme among those of `options`.
fn from_outside(scheme: &str, options: &Options) -> io::Result<Arc<dyn LaneTransport>> {
    if let Some(transport) = options.transports.iter().find(|transport| transport.scheme() == scheme) {
        return Ok(streams(Arc::clone(transport)));
    }
    let lanes = options.lane_transports.iter().find(|transport| transport.scheme() == scheme);
    lanes.cloned().ok_or_else(|| {
        let why = format!(
            "there is no transport {scheme} here: build with its feature, or add it to the options' transports"
        );
        io::Error::new(io::ErrorKind::Unsupported, why)
    })
}
