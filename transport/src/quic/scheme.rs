//! Sockets for QUIC.

use std::sync::Arc;

use trimaran_net::{BoxFuture, Net};
use trimaran_wire::MAX_CHANNELS;

use super::{QuicOptions, connect, listen};
use crate::HostPort;
use crate::acceptor::Acceptor;
use crate::keys::Security;
use crate::lane_transport::{Introduction, LaneTransport, Listened};
use crate::parts::LinkParts;
use crate::transport::{AttemptError, ListenFault, first_address};

/// A socket for QUIC.
#[derive(Debug)]
pub(crate) struct Quic {
    pub(crate) options: QuicOptions,
    pub(crate) security: Option<Security>,
}

impl LaneTransport for Quic {
    fn scheme(&self) -> &'static str {
        "quic"
    }

    fn channels(&self) -> usize {
        MAX_CHANNELS
    }

    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<LinkParts, AttemptError>> {
        Box::pin(connect::attempt(net, address, self, introduction))
    }

    fn listen<'a>(
        &'a self,
        address: &'a str,
        acceptor: &'a Arc<Acceptor>,
    ) -> BoxFuture<'a, Result<Listened, ListenFault>> {
        Box::pin(async move {
            let to = first_address(&acceptor.net, address).await?;
            Ok(HostPort::from(listen::listen(to, self, acceptor)?).to_string().into())
        })
    }
}
