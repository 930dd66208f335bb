//! Making a link over byte streams: a connection for each lane, with a hello and an answer.

use std::sync::Arc;

use trimaran_wire::Lane;

use super::Streams;
use super::handshake::{Connection, Lanes};
use crate::connect::{AttemptError, Introduction};
use crate::handshake::{Handshake, HandshakeError};
use crate::link::Parts;
use crate::stats::Counters;
use trimaran_net::{Net, StreamPeer};

/// Opens the connections to whoever listens there, says hello on each, and reads the answers.
pub(crate) async fn introduce(
    net: &Arc<dyn Net>,
    streams: &Streams,
    introduction: &Introduction<'_>,
) -> Result<Parts, AttemptError> {
    let Introduction { application, session, options, .. } = *introduction;
    let (to, transport) = (streams.endpoint.address(), &*streams.transport);
    let capabilities = streams.capabilities();
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
    let ((mut latest, _), (mut messages, _)) =
        tokio::try_join!(connection(Some(peer)), connection(Some(peer)))?;
    let address = frames.address.to_string();
    let failed = |cause| AttemptError::Handshake { address, cause };
    let theirs = async {
        frames.greet(application.introduce(session, Lane::Frames)).await?;
        latest.greet(application.introduce(session, Lane::Latest)).await?;
        messages.greet(application.introduce(session, Lane::Messages)).await?;
        // Whichever lane is refused says why at once, and the others only when they have waited for it.
        let (theirs, _, _) =
            tokio::try_join!(frames.recv_answer(), latest.recv_answer(), messages.recv_answer())?;
        application.recognize(&theirs)
    }
    .await
    .map_err(failed)?;
    let lanes = Lanes { latest, frames, messages, capabilities };
    Ok(lanes.into_parts(net, &options.link, format, theirs, session, None))
}
