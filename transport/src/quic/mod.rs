//! Links over QUIC (RFC 9000): latest values as datagrams, a stream for each frame, TLS 1.3 with both sides'
//! certificates pinned.
//!
//! The peer that connects opens two streams in both directions. The control stream: hello and its answer, then
//! copies of values that no newer one has followed, then the close of the latest lane. And the messages
//! stream. See `transport/wire/WIRE.md`.

mod carrier;
mod connect;
mod control;
mod frames;
mod latest;
#[cfg(test)]
mod lies;
mod listen;
mod messages;
mod options;
mod runtime;
mod tls;

pub(crate) use frames::{FrameRx, FrameTx};
pub(crate) use latest::{LatestRx, LatestTx};
pub(crate) use messages::{MessageRx, MessageTx};
pub use options::{Congestion, QuicOptions};
pub use tls::UnknownPeer;

use std::sync::Arc;

use crate::acceptor::Acceptor;
use crate::connect::{AttemptError, Introduction};
use crate::link::{Capabilities, Parts};
use crate::scheme::{Listened, Scheme, first_address};
use crate::transport::ListenFault;
use crate::{Endpoint, HostPort};
use trimaran_net::{BoxFuture, Net};

/// A socket for QUIC.
pub(crate) struct Quic(pub(crate) HostPort);

impl Scheme for Quic {
    fn attempt<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<Parts, AttemptError>> {
        Box::pin(connect::attempt(net, &self.0, introduction))
    }

    fn listen<'a>(&'a self, acceptor: &'a Arc<Acceptor>) -> BoxFuture<'a, Result<Listened, ListenFault>> {
        Box::pin(async move {
            let to = first_address(&acceptor.net, &self.0.to_string()).await?;
            Ok(Endpoint::Quic(listen::listen(to, acceptor)?.into()).into())
        })
    }
}

const CAPABILITIES: Capabilities =
    Capabilities { reliable: true, ordered: true, encrypted: true, local: false };
