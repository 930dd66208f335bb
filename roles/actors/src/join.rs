//! How roles find each other. Start order does not matter: the connecting side retries.

use std::{sync::Arc, time::Duration};

use thiserror::Error;
use trimaran_proto::Role;
use trimaran_transport::{
    ConnectError, Endpoint, Instant, Net, Options, causes, growing_pauses, sleep_until,
};

use crate::links::Link;

/// The pause after the first failed attempt; it doubles up to [`LONGEST_PAUSE`].
const FIRST_PAUSE: Duration = Duration::from_millis(200);
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// Why a role did not find another one.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum JoinError {
    /// A peer cannot be reached, or refuses.
    #[error("joining the {peer} failed")]
    Connect {
        /// The peer.
        peer: Role,
        /// The cause.
        #[source]
        cause: Box<ConnectError>,
    },
    /// Another role is at the address of a peer.
    #[error("a {came} is where a {due} was due; check the roles and addresses in the configurations")]
    Stranger {
        /// The role found.
        came: Role,
        /// The expected role.
        due: Role,
    },
}

impl JoinError {
    /// Whether another try may succeed with time or a repair of another machine. Any other failure is due to
    /// this role's own settings.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Stranger { .. } => true,
            Self::Connect { cause, .. } => cause.may_pass(),
        }
    }
}

/// The endpoint of a peer, with the options of the link.
#[derive(Debug, Clone)]
pub struct PeerEndpoint {
    /// The endpoint.
    pub endpoint: Endpoint,
    /// The options, with the peer's expected key.
    pub options: Options,
}

/// Repeats `attempt`, after growing pauses, until it succeeds, the deadline has come, or its error cannot
/// pass. Each new reason is logged.
///
/// Cancel safe if `attempt` is.
///
/// # Errors
/// That of the last attempt.
pub async fn again<T, E: std::error::Error + 'static, F: Future<Output = Result<T, E>>>(
    net: &Arc<dyn Net>,
    deadline: Instant,
    may_pass: impl Fn(&E) -> bool,
    mut attempt: impl FnMut() -> F,
) -> Result<T, E> {
    let mut logged = String::new();
    let mut pauses = growing_pauses(FIRST_PAUSE, LONGEST_PAUSE);
    loop {
        let error = match attempt().await {
            Err(error) if net.now() < deadline && may_pass(&error) => causes(&error),
            result => return result,
        };
        if error != logged {
            tracing::warn!("{error}; trying again");
            logged = error;
        }
        let pause = pauses.next().unwrap_or(LONGEST_PAUSE);
        sleep_until(&**net, net.now().after(pause).min(deadline)).await;
    }
}

/// Checks that the peer of `link` has the expected role. A relay may stand for a culler.
pub(crate) fn expect_role(link: &Link, due: Role) -> Result<(), JoinError> {
    let came = link.peer.hello.role;
    let stands_in = (came, due) == (Role::Relay, Role::Culler);
    if came == due || stands_in { Ok(()) } else { Err(JoinError::Stranger { came, due }) }
}
