//! Connecting to a listener that may not be there yet, over the transport of its endpoint.

use std::io;
use std::iter::successors;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_wire::{Format, Protocol, Refusal, SessionId, WireVersions};

use crate::application::{Application, Side};
use crate::causes::causes;
use crate::error::readable;
use crate::handshake::HandshakeError;
use crate::lane_transport::Introduction;
use crate::parts::LinkParts;
use crate::schemes::transport_of;
use crate::transport::AttemptError;
use crate::{Endpoint, Link, Options};
use trimaran_net::{Instant, Net, sleep_until, until};

/// The pause between two attempts is this part of the time since the first one: a listener that comes back is
/// found within a tenth of the time that it was away.
const PART: u32 = 10;
/// The shortest and the longest pause between two attempts.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LAST_PAUSE: Duration = Duration::from_secs(2);

/// Why no link was made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// The deadline came before a link. It may pass: the cause is time, the peer or somebody on the path.
    #[error(
        "no link to {endpoint} within {:?} and {attempts} attempt{}{}",
        readable(.waited),
        if *.attempts == 1 { "" } else { "s" },
        if .last.is_mismatch() { "" } else { ": is a peer running there?" }
    )]
    Deadline {
        /// The listener.
        endpoint: Endpoint,
        /// The time waited.
        waited: Duration,
        /// The number of attempts.
        attempts: u32,
        /// The error of the last attempt that ended.
        #[source]
        last: AttemptError,
    },
    /// This side's own settings cannot be used: its keys, or this kind of endpoint on this system. It does
    /// not pass.
    #[error("no link to {endpoint} can be made")]
    Failed {
        /// The listener.
        endpoint: Endpoint,
        /// The cause.
        #[source]
        cause: AttemptError,
    },
    /// The system has no random numbers for a session id. It may pass: this side's settings are not at fault.
    #[error("the system gives no random number for the session id")]
    Random(#[source] io::Error),
}

impl ConnectError {
    /// Whether the same call may succeed later: time, the peer or another machine may fix it. Otherwise this
    /// side's settings have to change.
    #[must_use]
    pub const fn may_pass(&self) -> bool {
        match self {
            Self::Deadline { .. } | Self::Random(_) => true,
            Self::Failed { .. } => false,
        }
    }

    /// The listener's refusal, if the last attempt ended with one. Over TCP and Unix sockets it is not
    /// authenticated.
    #[must_use]
    pub const fn refusal(&self) -> Option<&Refusal> {
        match self {
            Self::Deadline {
                last: AttemptError::Handshake { cause: HandshakeError::Refused(refusal), .. },
                ..
            } => Some(refusal),
            _ => None,
        }
    }
}

/// Connects to the listener at `endpoint`, retrying until `deadline`: either peer may start first.
///
/// Between two attempts is a random pause of at most a tenth of the time since the first one, from 0.1 to
/// 2 s. Each new obstacle is logged once.
///
/// Dropping the future ends the current attempt. If the listener has already made a link of it, that link
/// ends as lost.
///
/// # Errors
/// At once if this side's own settings cannot be used. Everything else is retried, also refusals: a stranger
/// may have the address for a moment, and the peer may restart with other data or other keys. Then the call
/// ends at the deadline, with the last attempt's error as the source.
pub async fn connect<P: Protocol>(
    net: &Arc<dyn Net>,
    endpoint: &Endpoint,
    hello: P::Hello,
    options: &Options,
    deadline: Instant,
) -> Result<Link<P>, ConnectError> {
    let application = introduced::<P>(endpoint, hello)?;
    let started = net.now();
    let mut attempts = 0;
    let mut known = None;
    let mut logged = String::new();
    loop {
        attempts += 1;
        let timeout = net.now().after(options.link.handshake_timeout).min(deadline);
        let last = match attempt::<P>(net, endpoint, &*application, options, timeout).await? {
            Some(Ok(link)) => return Ok(link),
            Some(Err(e)) if timeout == deadline && e.is_silence() => known.unwrap_or(e),
            Some(Err(cause)) if cause.is_final() => {
                return Err(ConnectError::Failed { endpoint: endpoint.clone(), cause });
            }
            Some(Err(last)) => last,
            // An attempt cut short by the deadline tells less than the one before.
            None => known.filter(|_| timeout == deadline).unwrap_or(AttemptError::TimedOut),
        };
        let obstacle = causes(&last);
        match (obstacle == logged, last.is_mismatch()) {
            (true, _) => tracing::debug!(%endpoint, attempts, "no link yet"),
            (false, true) => tracing::warn!(%endpoint, "no link yet, trying again: {obstacle}"),
            (false, false) => tracing::info!(%endpoint, "no link yet, trying again: {obstacle}"),
        }
        logged = obstacle;
        let pause = (net.now().since(started) / PART).clamp(FIRST_PAUSE, LAST_PAUSE);
        let pause = jittered(pause, &**net).map_err(ConnectError::Random)?;
        let next = net.now().after(pause);
        if next >= deadline {
            let waited = net.now().since(started);
            return Err(ConnectError::Deadline { endpoint: endpoint.clone(), waited, attempts, last });
        }
        sleep_until(&**net, next).await;
        known = Some(last);
    }
}

/// As [`connect`] with one attempt, for a check: a closed port and a refusal end it at once.
///
/// # Errors
/// If the attempt fails, or is not over at `deadline`.
pub async fn connect_once<P: Protocol>(
    net: &Arc<dyn Net>,
    endpoint: &Endpoint,
    hello: P::Hello,
    options: &Options,
    deadline: Instant,
) -> Result<Link<P>, ConnectError> {
    let application = introduced::<P>(endpoint, hello)?;
    let started = net.now();
    let last = match attempt::<P>(net, endpoint, &*application, options, deadline).await? {
        Some(Ok(link)) => return Ok(link),
        Some(Err(cause)) if cause.is_final() => {
            return Err(ConnectError::Failed { endpoint: endpoint.clone(), cause });
        }
        Some(Err(last)) => last,
        None => AttemptError::TimedOut,
    };
    let waited = net.now().since(started);
    Err(ConnectError::Deadline { endpoint: endpoint.clone(), waited, attempts: 1, last })
}

/// This side of the link's protocol.
#[expect(clippy::result_large_err, reason = "as `connect` has it")]
fn introduced<P: Protocol>(
    endpoint: &Endpoint,
    hello: P::Hello,
) -> Result<Arc<dyn Application>, ConnectError> {
    Side::<P>::of(hello).map_err(|e| ConnectError::Failed {
        endpoint: endpoint.clone(),
        cause: AttemptError::Handshake { address: endpoint.to_string(), cause: e.into() },
    })
}

/// One attempt at a link; `None` if it was not over in time.
async fn attempt<P: Protocol>(
    net: &Arc<dyn Net>,
    endpoint: &Endpoint,
    application: &dyn Application,
    options: &Options,
    by: Instant,
) -> Result<Option<Result<Link<P>, AttemptError>>, ConnectError> {
    let session = SessionId(net.random().map_err(ConnectError::Random)?);
    let (link, versions) = (&options.link, options.link.versions);
    let mut introduction = Introduction { application, versions, session, link, by };
    let attempt = async {
        let unsupported = |cause| AttemptError::Connect { address: endpoint.to_string(), cause };
        let transport = transport_of(endpoint, options).map_err(unsupported)?;
        transport
            .check_channels(application)
            .map_err(|cause| AttemptError::Handshake { address: endpoint.to_string(), cause })?;
        let mut made = transport.connect(net, &endpoint.address(), &introduction).await;
        if let Err(AttemptError::Handshake { cause: HandshakeError::Refused(refusal), .. }) = &made
            && let Some(earlier) = without_range(versions, refusal)
        {
            introduction.versions = earlier;
            made = transport.connect(net, &endpoint.address(), &introduction).await;
        }
        believed::<P>(net, options, &application.format(), made?).await
    };
    Ok(until(&**net, by, attempt).await)
}

/// The version in common with a listener that refuses a hello with a range: version 4 knows none.
fn without_range(ours: WireVersions, refusal: &Refusal) -> Option<WireVersions> {
    let Refusal::Version { listener, .. } = refusal else { return None };
    let earlier = WireVersions::only(ours.in_common(*listener)?);
    (earlier != ours).then_some(earlier)
}

/// Endless pauses between attempts: each is twice the one before, up to `longest`.
pub fn growing_pauses(first: Duration, longest: Duration) -> impl Iterator<Item = Duration> {
    successors(Some(first), move |pause| Some((*pause * 2).min(longest)))
}

/// Between half and all of `pause`, so that peers of a lost listener do not all come back at once.
fn jittered(pause: Duration, net: &dyn Net) -> io::Result<Duration> {
    let part = net.random()? >> 32;
    let half = pause / 2;
    Ok(half + Duration::from_nanos((half.as_nanos() as u64).saturating_mul(part) >> 32))
}

/// The link, if its peer may have the role that it claims; otherwise closes it with the reason.
async fn believed<P: Protocol>(
    net: &Arc<dyn Net>,
    options: &Options,
    format: &Format,
    mut parts: LinkParts,
) -> Result<Link<P>, AttemptError> {
    let (address, doubt) = (parts.address.to_string(), parts.doubt.take());
    let failed = |cause| AttemptError::Handshake { address, cause };
    let link = parts.into_link::<P>(net, &options.link, format);
    match (link, doubt) {
        (Some(link), None) => Ok(link),
        (Some(link), Some(error)) => {
            if let Some(reason) = error.wrong_role() {
                // The peer need not receive it.
                let _unheard = link.close(reason).await;
            }
            Err(failed(error))
        }
        (None, _) => Err(failed(HandshakeError::Closed)),
    }
}

#[cfg(test)]
mod tests {
    #[cfg(feature = "quic")]
    use trimaran_wire::ProtocolName;
    use trimaran_wire::Rejection;

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

    fn cut_short(last: AttemptError) -> ConnectError {
        let endpoint = "tcp://there:1".parse().unwrap();
        ConnectError::Deadline { endpoint, waited: Duration::from_secs(1), attempts: 1, last }
    }

    fn handshake(cause: HandshakeError) -> AttemptError {
        AttemptError::Handshake { address: "there:1".to_owned(), cause }
    }

    #[cfg(feature = "quic")]
    #[test]
    fn whatever_a_peer_or_time_may_mend_may_pass_and_what_this_side_was_given_not() {
        let another_map = Refusal::Rejected(Rejection::new(1, "the maps differ"));
        let another_protocol = HandshakeError::Alpn(ProtocolName::new("robot/1"));
        for passing in [HandshakeError::Refused(another_map), another_protocol, HandshakeError::Stranger] {
            let attempt = handshake(passing);
            assert!(!attempt.is_final() && cut_short(attempt).may_pass());
        }
        assert!(ConnectError::Random(io::ErrorKind::Other.into()).may_pass());
        for at_fault in [
            handshake(HandshakeError::NoKeys),
            handshake(HandshakeError::Tls(String::new().into())),
            AttemptError::Connect { address: String::new(), cause: io::ErrorKind::Unsupported.into() },
        ] {
            assert!(at_fault.is_final(), "{at_fault:?}");
            let endpoint = "tcp://there:1".parse().unwrap();
            assert!(!ConnectError::Failed { endpoint, cause: at_fault }.may_pass());
        }
    }

    #[test]
    fn a_refusal_can_be_asked_for_and_is_no_sign_that_nobody_is_there() {
        let other = Refusal::Rejected(Rejection::new(1, "the maps differ"));
        let refused = cut_short(handshake(HandshakeError::Refused(other.clone())));
        assert_eq!((refused.refusal(), cut_short(AttemptError::TimedOut).refusal()), (Some(&other), None));
        assert!(!refused.to_string().contains("running there"), "{refused}");
        let busy = cut_short(handshake(HandshakeError::Refused(Refusal::Busy)));
        assert!(busy.to_string().contains("running there"), "{busy}");
    }
}
