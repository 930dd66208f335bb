//! Links over byte streams of any transport: a connection for each lane, with a hello and an answer.

use std::io;
use std::sync::Arc;

use trimaran_net::{BoxFuture, Net, StreamPeer};
use trimaran_wire::Lane;

use super::acceptor::serve;
use super::handshake::{Connection, Lanes};
use crate::Endpoint;
use crate::acceptor::Acceptor;
use crate::handshake::{Handshake, HandshakeError};
use crate::parts::Parts;
use crate::scheme::{Introduction, Listened, Scheme};
use crate::stats::Counters;
use crate::transport::{AttemptError, Capabilities, ListenFault, Listening, Transport};

/// Makes links with a byte stream for each lane.
#[derive(Debug, Clone)]
pub(crate) struct Streams {
    pub(crate) transport: Arc<dyn Transport>,
    pub(crate) endpoint: Endpoint,
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
            acceptor.net.spawn(Box::pin(serve(Arc::clone(acceptor), socket, Arc::clone(&self.transport))));
            Ok(at.into())
        })
    }
}

/// Opens the connections to the listener, sends a hello on each, and reads the answers.
async fn introduce(
    net: &Arc<dyn Net>,
    Streams { transport, endpoint }: &Streams,
    introduction: &Introduction<'_>,
) -> Result<Parts, AttemptError> {
    let Introduction { application, session, options, .. } = *introduction;
    let (to, transport) = (endpoint.address(), &**transport);
    let (format, counters) = (application.format(), Counters::framed());
    let connection = async |beside: Option<StreamPeer>| {
        let stream = transport.connect(net, &to, beside).await?;
        let peer = stream.peer;
        let connection = Connection::new(stream, transport, format, &counters);
        let failed = |e| AttemptError::Handshake {
            address: connection.address.to_string(),
            cause: HandshakeError::NotLetIn(e),
        };
        transport.admit(peer).map_err(failed)?;
        Ok::<_, AttemptError>((connection, peer))
    };
    let (mut frames, peer) = connection(None).await?;
    let ((mut latest, _), (mut messages, _), (mut bulk, _)) =
        tokio::try_join!(connection(Some(peer)), connection(Some(peer)), connection(Some(peer)))?;
    let address = frames.address.to_string();
    let failed = |cause| AttemptError::Handshake { address, cause };
    let theirs = async {
        frames.greet(application.introduce(session, Lane::Frames)).await?;
        latest.greet(application.introduce(session, Lane::Latest)).await?;
        messages.greet(application.introduce(session, Lane::Messages)).await?;
        bulk.greet(application.introduce(session, Lane::Bulk)).await?;
        // The refused lane gets its reason at once, the others only after waiting for it.
        let (theirs, ..) = tokio::try_join!(
            frames.recv_answer(),
            latest.recv_answer(),
            messages.recv_answer(),
            bulk.recv_answer()
        )?;
        application.recognize(&theirs)
    }
    .await
    .map_err(failed)?;
    let lanes = Lanes { latest, frames, messages, bulk, capabilities: Capabilities::over(transport) };
    Ok(lanes.into_parts(net, &options.link, format, theirs, session, None))
}
