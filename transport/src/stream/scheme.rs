//! Links over byte streams of any transport: a connection for each lane, with a hello and an answer.

use std::sync::Arc;

use trimaran_net::{BoxFuture, Net, StreamPeer};
use trimaran_wire::Lane;

use super::acceptor::serve;
use super::handshake::{Connection, Lanes};
use crate::acceptor::Acceptor;
use crate::handshake::{Handshake, HandshakeError};
use crate::lane_transport::{Introduction, LaneTransport, Listened};
use crate::parts::LinkParts;
use crate::stats::Counters;
use crate::transport::{AttemptError, Capabilities, ListenFault, Listening, Transport};

/// Makes links with a byte stream for each lane.
#[derive(Debug, Clone)]
pub(crate) struct Streams(pub(crate) Arc<dyn Transport>);

impl LaneTransport for Streams {
    fn scheme(&self) -> &'static str {
        self.0.scheme()
    }

    fn connect<'a>(
        &'a self,
        net: &'a Arc<dyn Net>,
        address: &'a str,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<LinkParts, AttemptError>> {
        Box::pin(introduce(net, address, &*self.0, introduction))
    }

    fn listen<'a>(
        &'a self,
        address: &'a str,
        acceptor: &'a Arc<Acceptor>,
    ) -> BoxFuture<'a, Result<Listened, ListenFault>> {
        Box::pin(async move {
            let Listening { socket, address } = self.0.listen(&acceptor.net, address).await?;
            let (serving, transport) = (acceptor.serving(), Arc::clone(&self.0));
            let served = serve(Arc::clone(acceptor), socket, transport);
            acceptor.net.spawn(Box::pin(async move {
                served.await;
                drop(serving);
            }));
            Ok(address.into())
        })
    }
}

/// Opens the connections to the listener, sends a hello on each, and reads the answers.
async fn introduce(
    net: &Arc<dyn Net>,
    to: &str,
    transport: &dyn Transport,
    introduction: &Introduction<'_>,
) -> Result<LinkParts, AttemptError> {
    let (format, counters) = (introduction.format(), Counters::framed());
    let connection = async |beside: Option<StreamPeer>| {
        let stream = transport.connect(net, to, beside).await?;
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
    let answered = async {
        frames.greet(introduction.hello(Lane::Frames)).await?;
        latest.greet(introduction.hello(Lane::Latest)).await?;
        messages.greet(introduction.hello(Lane::Messages)).await?;
        bulk.greet(introduction.hello(Lane::Bulk)).await?;
        // The refused lane gets its reason at once, the others only after waiting for it.
        let (accept, ..) = tokio::try_join!(
            frames.recv_answer(),
            latest.recv_answer(),
            messages.recv_answer(),
            bulk.recv_answer()
        )?;
        Ok((introduction.recognize(&accept.application)?, accept.idle_timeout))
    }
    .await;
    let (theirs, idle_timeout) = answered.map_err(failed)?;
    let idle_timeout = introduction.link.agreed(idle_timeout);
    let lanes = Lanes { latest, frames, messages, bulk, capabilities: Capabilities::over(transport) };
    Ok(lanes.into_parts(net, idle_timeout, theirs, introduction.session))
}
