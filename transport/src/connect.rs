//! Connecting to a listener that may not be there yet, over whatever transport its endpoint names.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_proto::{Identity, Refusal, SessionId};

use crate::error::readable;
use crate::handshake::HandshakeError;
use crate::net::{Instant, Net, sleep_until, until};
use crate::{Endpoint, HostPort, Link, Name, Options, inproc, quic, tcp, udp, unix};

/// The pause after the first attempt; it doubles up to [`LAST_PAUSE`].
const FIRST_PAUSE: Duration = Duration::from_millis(20);
/// The longest pause between two attempts.
const LAST_PAUSE: Duration = Duration::from_secs(1);

/// How this side introduces itself in one attempt.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Introduction<'o> {
    pub(crate) identity: Identity,
    pub(crate) session: SessionId,
    pub(crate) options: &'o Options,
    /// When the attempt is cut short.
    pub(crate) by: Instant,
}

/// Why no link came about.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// The listener is there and refuses: trying again would not help.
    #[error("{endpoint} refuses: {refusal}")]
    Refused {
        /// Whom we asked.
        endpoint: Endpoint,
        /// Its reason.
        refusal: Refusal,
    },
    /// The deadline came before a link.
    #[error(
        "no link to {endpoint} within {:?} and {attempts} attempt{}: is the other role running there?",
        readable(.waited),
        if *.attempts == 1 { "" } else { "s" }
    )]
    Deadline {
        /// Whom we asked.
        endpoint: Endpoint,
        /// How long.
        waited: Duration,
        /// How often.
        attempts: u32,
        /// What went wrong the last time that an attempt came to an end.
        #[source]
        last: AttemptError,
    },
    /// The attempt failed in a way that trying again cannot mend.
    #[error("no link to {endpoint} can be made")]
    Failed {
        /// Whom we asked.
        endpoint: Endpoint,
        /// Why.
        #[source]
        cause: AttemptError,
    },
    /// The system has no random numbers for a session id.
    #[error("the system gives no random number for the session id")]
    Random(#[source] io::Error),
}

impl ConnectError {
    /// Whether it may work another time though nothing is changed: the peer was not there in time, or holds the place of a process
    /// that is gone for this one's. Any other failure is about what one of the sides was given.
    #[must_use]
    pub const fn may_pass(&self) -> bool {
        matches!(self, Self::Deadline { .. } | Self::Refused { refusal: Refusal::RoleTaken { .. }, .. })
    }
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
        address: String,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// A connection, but no handshake.
    #[error("no handshake with {address}")]
    Handshake {
        /// With whom.
        address: String,
        /// Why.
        #[source]
        cause: HandshakeError,
    },
    /// Nobody in this process listens under the name.
    #[error("nobody in this process listens as {name}")]
    Nobody {
        /// The name.
        name: Name,
    },
    /// The attempt itself took too long.
    #[error("no answer in time")]
    TimedOut,
}

impl AttemptError {
    /// Whether nobody said anything.
    const fn is_silence(&self) -> bool {
        matches!(self, Self::Handshake { cause: HandshakeError::Unanswered, .. })
    }

    /// Whether another attempt would end the same.
    const fn is_final(&self) -> bool {
        matches!(
            self,
            Self::Handshake {
                cause: HandshakeError::ForeignUser(_)
                    | HandshakeError::NoKeys
                    | HandshakeError::Tls(_)
                    | HandshakeError::UnknownPeer(_)
                    | HandshakeError::WrongRole(_)
                    | HandshakeError::NotKnown { .. }
                    | HandshakeError::Alpn
                    | HandshakeError::Datagrams { .. },
                ..
            }
        )
    }
}

/// Connects to the listener at `endpoint`, trying again until `deadline`: which of two peers starts first does
/// not matter.
///
/// # Errors
/// When the listener refuses, or no link came about before the deadline; then the last attempt's error is the source.
pub async fn connect(
    net: &Arc<dyn Net>,
    endpoint: &Endpoint,
    identity: Identity,
    options: &Options,
    deadline: Instant,
) -> Result<Link, ConnectError> {
    let started = net.now();
    let mut pause = FIRST_PAUSE;
    let mut attempts = 0;
    let mut known = None;
    loop {
        attempts += 1;
        let session = SessionId(net.random().map_err(ConnectError::Random)?);
        let patience = net.now().after(options.handshake).min(deadline);
        let introduction = Introduction { identity, session, options, by: patience };
        let attempt = attempt(net, endpoint, &introduction);
        let last = match until(&**net, patience, attempt).await {
            Some(Ok(link)) => return Ok(link),
            Some(Err(e)) if patience == deadline && e.is_silence() => known.unwrap_or(e),
            Some(Err(e)) => e,
            // An attempt that was cut short by the deadline tells less than the one before it.
            None => known.filter(|_| patience == deadline).unwrap_or(AttemptError::TimedOut),
        };
        let last = match last {
            AttemptError::Handshake { cause: HandshakeError::Refused(refusal), .. }
                if !refusal.is_passing() =>
            {
                return Err(ConnectError::Refused { endpoint: endpoint.clone(), refusal });
            }
            cause if cause.is_final() => {
                return Err(ConnectError::Failed { endpoint: endpoint.clone(), cause });
            }
            last => last,
        };
        tracing::debug!(%endpoint, attempts, error = &last as &dyn std::error::Error, "trying again");
        let next = net.now().after(jittered(pause, &**net).map_err(ConnectError::Random)?);
        if next >= deadline {
            let waited = net.now().since(started);
            return Err(ConnectError::Deadline { endpoint: endpoint.clone(), waited, attempts, last });
        }
        sleep_until(&**net, next).await;
        known = Some(last);
        pause = (pause * 2).min(LAST_PAUSE);
    }
}

/// Between a half and the whole of `pause`, so that peers which lost the same listener do not all come back at once.
fn jittered(pause: Duration, net: &dyn Net) -> io::Result<Duration> {
    let part = net.random()? >> 32;
    let half = pause / 2;
    Ok(half + Duration::from_nanos((half.as_nanos() as u64).saturating_mul(part) >> 32))
}

/// Tries each address of a host once, until one is there: whoever answers has the last word.
pub(crate) async fn each_address<F: Future<Output = Result<Link, AttemptError>>>(
    net: &Arc<dyn Net>,
    at: &HostPort,
    introduce: impl Fn(SocketAddr) -> F,
) -> Result<Link, AttemptError> {
    let mut last = AttemptError::NoAddress;
    for to in net.resolve(&at.to_string()).await.map_err(AttemptError::Resolve)? {
        match introduce(to).await {
            Err(e @ AttemptError::Connect { .. }) => last = e,
            done => return done,
        }
    }
    Err(last)
}

/// The link, if its peer may have the role that it claims; else the peer is told why not.
pub(crate) async fn believed(link: Link, judged: Result<(), HandshakeError>) -> Result<Link, HandshakeError> {
    let Err(error) = judged else { return Ok(link) };
    if let HandshakeError::WrongRole(claim) = &error {
        // It need not be heard.
        let _unheard = link.goodbye(claim.goodbye()).await;
    }
    Err(error)
}

/// Tries once. Each transport has its arm here and in [`Listener::bind`](crate::Listener::bind).
async fn attempt(
    net: &Arc<dyn Net>,
    endpoint: &Endpoint,
    introduction: &Introduction<'_>,
) -> Result<Link, AttemptError> {
    match endpoint {
        Endpoint::Tcp(at) => tcp::attempt(net, at, introduction).await,
        Endpoint::Unix(path) => unix::attempt(net, path, introduction).await,
        Endpoint::Inproc(name) => inproc::attempt(net, name, introduction).await,
        Endpoint::Quic(at) => quic::attempt(net, at, introduction).await,
        Endpoint::Udp(at) => udp::attempt(net, at, introduction).await,
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{Role, SceneHash};

    use super::*;

    #[test]
    fn who_waited_reads_how_long_and_how_often() {
        let deadline = |waited, attempts| ConnectError::Deadline {
            endpoint: "tcp://there:1".parse().unwrap(),
            waited: Duration::from_nanos(waited),
            attempts,
            last: AttemptError::TimedOut,
        };
        let said = deadline(367_610_314, 6).to_string();
        assert!(said.starts_with("no link to tcp://there:1 within 367ms and 6 attempts:"), "{said}");
        let said = deadline(60_000_000_001, 1).to_string();
        assert!(said.contains("within 60s and 1 attempt:"), "{said}");
    }

    #[test]
    fn a_peer_that_is_late_or_keeps_a_place_may_be_tried_again_and_another_scene_not() {
        let endpoint = || "tcp://there:1".parse().unwrap();
        let refused = |refusal| ConnectError::Refused { endpoint: endpoint(), refusal };
        let (listener, connector) = (SceneHash(1), SceneHash(2));
        assert!(refused(Refusal::RoleTaken { role: Role::SwitchA }).may_pass());
        assert!(!refused(Refusal::Scene { listener, connector }).may_pass());
        let last = AttemptError::TimedOut;
        let waited = Duration::from_secs(1);
        assert!(ConnectError::Deadline { endpoint: endpoint(), waited, attempts: 1, last }.may_pass());
    }
}
