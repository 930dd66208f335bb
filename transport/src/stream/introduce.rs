//! Making a link over byte streams: two connections, a hello on each, an answer on each.

use std::fmt;
use std::io;
use std::sync::Arc;

use trimaran_wire::Lane;

use super::handshake::{Connection, Lanes};
use crate::connect::{AttemptError, Introduction};
use crate::handshake::Parley;
use crate::link::{Capabilities, Parts};
use crate::stats::Counters;
use crate::unix;
use trimaran_net::{BoxFuture, Net, Stream};

/// Opens both connections to `to`, says hello on both, and reads both answers.
pub(crate) async fn introduce<'o>(
    net: &Arc<dyn Net>,
    to: &(dyn fmt::Display + Sync),
    open: impl Fn() -> BoxFuture<'o, io::Result<Stream>>,
    introduction: &Introduction<'_>,
    capabilities: Capabilities,
) -> Result<Parts, AttemptError> {
    let Introduction { application, session, options, .. } = *introduction;
    let (format, counters) = (application.format(), Counters::framed());
    let failed = |cause| AttemptError::Handshake { address: to.to_string(), cause };
    let connection = async || match open().await {
        Ok(stream) => {
            unix::check(stream.peer, &options.unix).map_err(|e| failed(e.into()))?;
            Ok(Connection::new(stream, format, &counters))
        }
        Err(cause) => Err(AttemptError::Connect { address: to.to_string(), cause }),
    };
    let mut frames = connection().await?;
    let mut latest = connection().await?;
    let theirs = async {
        frames.greet(application.introduce(session, Lane::Frames)).await?;
        latest.greet(application.introduce(session, Lane::Latest)).await?;
        // Whichever lane is refused says why at once, and the other one only when it has waited for its twin.
        let (theirs, _) = tokio::try_join!(frames.recv_answer(), latest.recv_answer())?;
        application.recognize(&theirs)
    }
    .await
    .map_err(failed)?;
    let lanes = Lanes { latest, frames, capabilities };
    Ok(lanes.into_parts(net, &options.link, format, theirs, session, None))
}
