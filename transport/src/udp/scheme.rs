//! Sockets for datagrams.

use std::sync::Arc;

use trimaran_net::{BoxFuture, Net};

use super::{connect, listen};
use crate::acceptor::Acceptor;
use crate::parts::Parts;
use crate::scheme::{Introduction, Listened, Scheme, first_address};
use crate::transport::{AttemptError, ListenFault};
use crate::{Endpoint, UdpEndpoint};

/// A socket for datagrams.
pub(crate) struct Udp(pub(crate) UdpEndpoint);

impl Scheme for Udp {
    fn attempt<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<Parts, AttemptError>> {
        Box::pin(connect::attempt(net, &self.0, introduction))
    }

    fn listen<'a>(&'a self, acceptor: &'a Arc<Acceptor>) -> BoxFuture<'a, Result<Listened, ListenFault>> {
        Box::pin(async move {
            let UdpEndpoint { at, mode } = &self.0;
            let to = first_address(&acceptor.net, &at.to_string()).await?;
            let at = listen::listen(to, *mode, acceptor)?.into();
            Ok(Endpoint::Udp(UdpEndpoint { at, mode: *mode }).into())
        })
    }
}
