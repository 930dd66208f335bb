//! Links over whatever opens byte streams.

use std::io;
use std::sync::Arc;

use trimaran_net::{BoxFuture, Net};

use super::{introduce, serve};
use crate::Endpoint;
use crate::acceptor::Acceptor;
use crate::connect::{AttemptError, Introduction};
use crate::link::{Capabilities, Parts};
use crate::scheme::{Listened, Scheme};
use crate::transport::{ListenFault, Listening, Transport};

/// Makes links of a byte stream for each lane.
#[derive(Debug, Clone)]
pub(crate) struct Streams {
    pub(crate) transport: Arc<dyn Transport>,
    pub(crate) endpoint: Endpoint,
}

impl Streams {
    pub(super) fn capabilities(&self) -> Capabilities {
        Capabilities {
            reliable: true,
            ordered: true,
            encrypted: self.transport.is_encrypted(),
            local: self.transport.is_local(),
        }
    }
}

impl Scheme for Streams {
    fn attempt<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<Parts, AttemptError>> {
        Box::pin(introduce(net, self, introduction))
    }

    fn listen<'a>(&'a self, acceptor: &'a Arc<Acceptor>) -> BoxFuture<'a, Result<Listened, ListenFault>> {
        Box::pin(async move {
            let address = self.endpoint.address();
            let Listening { socket, address } = self.transport.listen(&acceptor.net, &address).await?;
            let at = self.endpoint.at(&address).map_err(io::Error::other)?;
            acceptor.net.spawn(Box::pin(serve(Arc::clone(acceptor), socket, self.clone())));
            Ok(at.into())
        })
    }
}
