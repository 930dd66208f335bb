//! How roles find each other. Start order does not matter: whoever connects tries again.

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
        /// Why.
        #[source]
        cause: Box<ConnectError>,
    },
    /// Another role is at the address of a peer.
    #[error("a {came} is where a {due} was due; check the roles and addresses in the configurations")]
    Stranger {
        /// Who is there.
        came: Role,
        /// Who should be.
        due: Role,
    },
}

impl JoinError {
    /// Whether it may work another time though nothing is changed here: time or another machine may mend it.
    /// Any other failure is about what this role was given.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Stranger { .. } => true,
            Self::Connect { cause, .. } => cause.may_pass(),
        }
    }
}

/// Where a role meets a peer, and what holds for their link.
#[derive(Debug, Clone)]
pub struct PeerEndpoint {
    /// Where.
    pub endpoint: Endpoint,
    /// How, and whom it expects there.
    pub options: Options,
}

/// What `attempt` gives in the end: it is made again, after a growing pause, until it works, the deadline has
/// come, or it fails with what cannot pass. A line in the log says why, whenever the reason is a new one.
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
    let mut said = String::new();
    let mut pauses = growing_pauses(FIRST_PAUSE, LONGEST_PAUSE);
    loop {
        let error = match attempt().await {
            Err(error) if net.now() < deadline && may_pass(&error) => causes(&error),
            result => return result,
        };
        if error != said {
            tracing::warn!("{error}; trying again");
            said = error;
        }
        let pause = pauses.next().unwrap_or(LONGEST_PAUSE);
        sleep_until(&**net, net.now().after(pause).min(deadline)).await;
    }
}

/// That the peer of `link` is what it should be.
pub(crate) fn expect_role(link: &Link, due: Role) -> Result<(), JoinError> {
    let came = link.peer.hello.role;
    if came == due { Ok(()) } else { Err(JoinError::Stranger { came, due }) }
}
