//! Sockets for QUIC.

use std::sync::Arc;

use trimaran_net::{BoxFuture, Net};

use super::{connect, listen};
use crate::acceptor::Acceptor;
use crate::parts::Parts;
use crate::scheme::{Introduction, Listened, Scheme, first_address};
use crate::transport::{AttemptError, ListenFault};
use crate::{Endpoint, HostPort};

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
