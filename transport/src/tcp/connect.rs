//! Connecting to a listener that may not be there yet.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_proto::{Identity, Lane, Message, Refusal, SessionId};

use super::handshake::{Connection, HandshakeError, Lanes};
use super::options::Options;
use crate::Link;
use crate::net::{Instant, Net, sleep_until, until};
use crate::stats::Counters;

/// The pause after the first attempt; it doubles up to [`LAST_PAUSE`].
const FIRST_PAUSE: Duration = Duration::from_millis(20);
/// The longest pause between two attempts.
const LAST_PAUSE: Duration = Duration::from_secs(1);

/// Why no link came about.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// The listener is there and refuses: trying again would not help.
    #[error("{address} refuses: {refusal}")]
    Refused {
        /// Whom we asked.
        address: String,
        /// Its reason.
        refusal: Refusal,
    },
    /// The deadline came before a link.
    #[error(
        "no link to {address} within {waited:?} and {attempts} attempts: is the other role running there?"
    )]
    Deadline {
        /// Whom we asked.
        address: String,
        /// How long.
        waited: Duration,
        /// How often.
        attempts: u32,
        /// What went wrong the last time.
        #[source]
        last: AttemptError,
    },
    /// The address is none.
    #[error("{address:?} is not an address of the form host:port")]
    Address {
        /// What was given.
        address: String,
        /// What the resolver says.
        #[source]
        cause: io::Error,
    },
    /// The system has no random numbers for a session id.
    #[error("the system gives no random number for the session id")]
    Random(#[source] io::Error),
}

/// Why one attempt failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AttemptError {
    /// The host name has no address now.
    #[error("the host name could not be resolved")]
    Resolve(#[source] io::Error),
    /// The host name has no address at all.
    #[error("the host name has no address")]
    NoAddress,
    /// No connection.
    #[error("no connection to {address}")]
    Connect {
        /// Where to.
        address: SocketAddr,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// A connection, but no handshake.
    #[error("no handshake with {address}")]
    Handshake {
        /// With whom.
        address: SocketAddr,
        /// Why.
        #[source]
        cause: HandshakeError,
    },
    /// The attempt itself took too long.
    #[error("no answer in time")]
    TimedOut,
}

/// Connects to the listener at `address` (`host:port`), trying again until `deadline`: which of two peers starts first does
/// not matter.
///
/// # Errors
/// When the listener refuses, or no link came about before the deadline; then the last attempt's error is the source.
pub async fn connect(
    net: &Arc<dyn Net>,
    address: &str,
    identity: Identity,
    options: &Options,
    deadline: Instant,
) -> Result<Link, ConnectError> {
    let started = net.now();
    let mut pause = FIRST_PAUSE;
    let mut attempts = 0;
    loop {
        attempts += 1;
        let session = SessionId(net.random().map_err(ConnectError::Random)?);
        let patience = net.now().after(options.handshake).min(deadline);
        let attempt = attempt(net, address, identity, session, options);
        let last = match until(&**net, patience, attempt).await {
            Some(Ok(link)) => return Ok(link),
            Some(Err(e)) => e,
            None => AttemptError::TimedOut,
        };
        match last {
            AttemptError::Handshake { cause: HandshakeError::Refused(refusal), .. }
                if refusal != Refusal::Busy =>
            {
                return Err(ConnectError::Refused { address: address.to_owned(), refusal });
            }
            AttemptError::Resolve(cause) if cause.kind() == io::ErrorKind::InvalidInput => {
                return Err(ConnectError::Address { address: address.to_owned(), cause });
            }
            _ => tracing::debug!(address, attempts, error = &last as &dyn std::error::Error, "trying again"),
        }
        let next = net.now().after(pause);
        if next >= deadline {
            let waited = net.now().since(started);
            return Err(ConnectError::Deadline { address: address.to_owned(), waited, attempts, last });
        }
        sleep_until(&**net, next).await;
        pause = (pause * 2).min(LAST_PAUSE);
    }
}

/// Tries each address of the name once.
async fn attempt(
    net: &Arc<dyn Net>,
    address: &str,
    identity: Identity,
    session: SessionId,
    options: &Options,
) -> Result<Link, AttemptError> {
    let mut last = AttemptError::NoAddress;
    for to in net.resolve(address).await.map_err(AttemptError::Resolve)? {
        match introduce(net, to, identity, session, options).await {
            Err(e @ AttemptError::Connect { .. }) => last = e,
            done => return done,
        }
    }
    Err(last)
}

/// Opens both connections, says hello on both, and reads both answers.
async fn introduce(
    net: &Arc<dyn Net>,
    to: SocketAddr,
    identity: Identity,
    session: SessionId,
    options: &Options,
) -> Result<Link, AttemptError> {
    let counters = Counters::framed();
    let open = async || match net.connect_tcp(to, options.tcp).await {
        Ok(stream) => Ok(Connection::new(stream, &counters)),
        Err(cause) => Err(AttemptError::Connect { address: to, cause }),
    };
    let mut frames = open().await?;
    let mut latest = open().await?;
    let theirs = async {
        frames.send(&Message::Hello(identity.hello(session, Lane::Frames))).await?;
        latest.send(&Message::Hello(identity.hello(session, Lane::Latest))).await?;
        let theirs = frames.recv_answer().await?;
        latest.recv_answer().await?;
        Ok(theirs)
    }
    .await
    .map_err(|cause| AttemptError::Handshake { address: to, cause })?;
    Ok(Lanes { latest, frames }.into_link(net, &options.link, &identity, theirs, session, None))
}
