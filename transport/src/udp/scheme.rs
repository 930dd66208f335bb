//! Sockets for datagrams.

use std::sync::Arc;

use trimaran_net::{BoxFuture, Net};
use trimaran_wire::MAX_CHANNELS;

use super::{UdpOptions, connect, listen};
use crate::acceptor::Acceptor;
use crate::keys::Security;
use crate::lane_transport::{Introduction, LaneTransport, Listened};
use crate::parts::LinkParts;
use crate::transport::{AttemptError, ListenFault, first_address};
use crate::{HostPort, UdpEndpoint};

/// A socket for datagrams.
#[derive(Debug)]
pub(crate) struct Udp {
    pub(crate) at: UdpEndpoint,
    pub(crate) options: UdpOptions,
    pub(crate) security: Option<Security>,
}

impl LaneTransport for Udp {
    fn scheme(&self) -> &'static str {
        "udp"
    }

    fn channels(&self) -> usize {
        MAX_CHANNELS
    }

    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        _address: &'a str,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<LinkParts, AttemptError>> {
        Box::pin(connect::attempt(net, self, introduction))
    }

    fn listen<'a>(
        &'a self,
        _address: &'a str,
        acceptor: &'a Arc<Acceptor>,
    ) -> BoxFuture<'a, Result<Listened, ListenFault>> {
        Box::pin(async move {
            let to = first_address(&acceptor.net, &self.at.at.to_string()).await?;
            Ok(HostPort::from(listen::listen(to, self, acceptor)?).to_string().into())
        })
    }
}
