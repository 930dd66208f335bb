//! Links over byte streams of any transport: a connection for each lane and channel, with a hello and an
//! answer.

use std::sync::Arc;

use trimaran_net::{BoxFuture, Net, StreamPeer};
use trimaran_wire::{ChannelNumber, Lane, MAX_CHANNELS};

use super::acceptor::serve;
use super::handshake::{Connection, Lanes};
use crate::acceptor::Acceptor;
use crate::concurrent::try_all;
use crate::handshake::{Handshake, HandshakeError};
use crate::lane_transport::{Introduction, LaneTransport, Listened};
use crate::parts::LinkParts;
use crate::stats::Counters;
use crate::transport::{AttemptError, ListenFault, Listening, Transport};

/// Makes links with a byte stream for each lane.
#[derive(Debug, Clone)]
pub(crate) struct Streams(pub(crate) Arc<dyn Transport>);

impl LaneTransport for Streams {
    fn scheme(&self) -> &'static str {
        self.0.scheme()
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
    let (frames, peer) = connection(None).await?;
    let address = frames.address.to_string();
    let failed = |cause| AttemptError::Handshake { address, cause };
    let channels = (0..).zip(format.channels).map(|(number, _)| Lane::Channel(ChannelNumber(number)));
    let others: Vec<_> = [Lane::Latest, Lane::Messages, Lane::Bulk].into_iter().chain(channels).collect();
    let beside = try_all(others.iter().map(|_| connection(Some(peer)))).await?;
    let beside = others.into_iter().zip(beside.into_iter().map(|(connection, _)| connection));
    let mut all: Vec<_> = [(Lane::Frames, frames)].into_iter().chain(beside).collect();
    let answered = async {
        for (lane, connection) in &mut all {
            connection.greet(introduction.hello(*lane)).await?;
        }
        // The refused lane gets its reason at once, the others only after waiting for it.
        let accepts = try_all(all.iter_mut().map(|(_, connection)| connection.recv_answer())).await?;
        let accept = accepts.first().ok_or(HandshakeError::Closed)?;
        let theirs = introduction.recognize(accept)?;
        let lanes = Lanes::of(all.into_iter().collect(), format.channels, transport);
        Ok((theirs, accept.idle_timeout, lanes.ok_or(HandshakeError::Closed)?))
    }
    .await;
    let (theirs, idle_timeout, lanes) = answered.map_err(failed)?;
    let idle_timeout = introduction.link.agreed(idle_timeout);
    Ok(lanes.into_parts(net, idle_timeout, theirs, introduction.session))
}
