//! Three roles find each other, over whatever transports their endpoints name. Start order does not matter:
//! whoever connects tries again until the deadline, and whoever waits for one peer notices when the other one
//! leaves.

use std::{future::pending, sync::Arc, time::Duration};

use thiserror::Error;
use trimaran_proto::{CloseCode, Identity, Role, SceneHash, Settings, Walkthrough};
use trimaran_transport::{
    AcceptError, ConnectError, Endpoint, Instant, ListenError, Net, Options, RecvError, causes, connect,
    growing_pauses, sleep_until,
};

use crate::{
    links::{Link, Listener},
    machine::CullerIndex,
};

/// The pause after the first failed attempt; it doubles up to [`LONGEST_PAUSE`].
const FIRST_PAUSE: Duration = Duration::from_millis(200);
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// Why a role did not find the others.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum JoinError {
    /// The role cannot listen.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// A peer did not come.
    #[error("waiting for the {peer} failed")]
    Accept {
        /// The peer that was missing.
        peer: Role,
        /// Why.
        #[source]
        cause: Box<AcceptError>,
    },
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
    #[error("the {came} is where the {due} was due; check the roles and addresses in the configurations")]
    Stranger {
        /// Who is there.
        came: Role,
        /// Who should be.
        due: Role,
    },
    /// The display left before the other culler had come.
    #[error("the display left before the other culler had come")]
    Left(#[source] RecvError),
    /// The display's address belongs to something that dictates no session.
    #[error("the peer at the display's address dictates no session")]
    NoSettings,
}

impl JoinError {
    /// Whether it may work another time though nothing is changed here: time or another machine may mend it.
    /// Any other failure is about what this role was given.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Listen(cause) => cause.may_pass(),
            Self::Accept { .. } | Self::Stranger { .. } | Self::Left(_) | Self::NoSettings => true,
            Self::Connect { cause, .. } => cause.may_pass(),
        }
    }

    /// Whether another attempt before the deadline may work: what may pass, unless the deadline itself ended
    /// this one.
    #[must_use]
    pub fn is_early(&self) -> bool {
        let over = match self {
            Self::Accept { cause, .. } => matches!(**cause, AcceptError::Deadline { .. }),
            Self::Connect { cause, .. } => matches!(**cause, ConnectError::Deadline { .. }),
            _ => false,
        };
        self.may_pass() && !over
    }
}

/// The display waits for both cullers on its listener; the links come first culler first. One
/// that leaves before the other has come is waited for again. A display that comes is turned away.
///
/// # Errors
/// When one has not come by the deadline.
pub async fn await_cullers(mut listener: Listener, deadline: Instant) -> Result<[Link; 2], JoinError> {
    let mut early: Option<Link> = None;
    loop {
        let missing = match &early {
            Some(link) if link.peer.hello.role == Role::FirstCuller => Role::SecondCuller,
            _ => Role::FirstCuller,
        };
        let early_left = async {
            match &mut early {
                Some(link) => left(link).await,
                None => pending().await,
            }
        };
        let came = tokio::select! {
            biased;
            end = early_left => {
                tracing::warn!(%end, "a culler left before the other one came");
                early = None;
                continue;
            }
            came = listener.accept(deadline) => {
                came.map_err(|cause| JoinError::Accept { peer: missing, cause: Box::new(cause) })?
            }
        };
        let role = came.peer.hello.role;
        tracing::info!(%role, from = %came.peer.address, "joined");
        if role == Role::Display {
            tracing::warn!(from = %came.peer.address, "turned another display away: it is to listen, not to join");
            let why = "a display has no place at another display";
            let _unheard = came.close(CloseCode::Failed.because(why)).await;
            continue;
        }
        early = Some(match early {
            None => came,
            Some(link) if role == Role::FirstCuller => return Ok([came, link]),
            Some(link) => return Ok([link, came]),
        });
    }
}

/// How a peer left before the session has begun. Until then nobody sends frames, whose lane can be watched;
/// the display's first camera may be there already.
async fn left(link: &mut Link) -> RecvError {
    loop {
        match link.frames_rx.recv().await {
            Ok(_) | Err(RecvError::Silent { .. }) => {}
            Err(end) => return end,
        }
    }
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

/// What a culler has once it has joined.
#[derive(Debug)]
pub struct Joined {
    /// The link to the display.
    pub display: Link,
    /// The link to the other culler.
    pub other: Link,
    /// What the display dictates.
    pub settings: Settings,
}

/// Where a role meets a peer, and what holds for their link.
#[derive(Debug, Clone)]
pub struct PeerEndpoint {
    /// Where.
    pub endpoint: Endpoint,
    /// How, and whom it expects there.
    pub options: Options,
}

/// A culler joins the display at `display` and the other culler: the first listens at `meet`, the
/// second connects there. The two links may go over different transports. When the display leaves before
/// the other culler has come, it joins the next one there.
///
/// # Errors
/// When a peer is not there by the deadline, refuses, or is not who it should be.
pub async fn join_session(
    net: &Arc<dyn Net>,
    index: CullerIndex,
    scene: SceneHash,
    display: &PeerEndpoint,
    meet: &PeerEndpoint,
    deadline: Instant,
) -> Result<Joined, JoinError> {
    let identity = |settings| Identity { role: index.role(), scene, settings };
    let once = || async {
        let mut display =
            connect::<Walkthrough>(net, &display.endpoint, identity(None), &display.options, deadline)
                .await
                .map_err(|cause| JoinError::Connect { peer: Role::Display, cause: Box::new(cause) })?;
        expect_role(&display, Role::Display)?;
        let settings = display.peer.hello.settings.ok_or(JoinError::NoSettings)?;
        let other = tokio::select! {
            biased;
            end = left(&mut display) => {
                tracing::warn!(%end, "the display left before the other culler came");
                return Err(JoinError::Left(end));
            }
            other = link_of_cullers(net, index, identity(Some(settings)), meet, deadline) => other,
        };
        let other = match other.and_then(|other| expect_role(&other, index.other().role()).map(|()| other)) {
            Ok(other) => other,
            Err(error) => {
                // It need not be heard; over QUIC the display would wait for the idle timeout without it.
                let _unheard = display.close(CloseCode::PeerLost.because(&causes(&error))).await;
                return Err(error);
            }
        };
        Ok(Joined { display, other, settings })
    };
    match once().await {
        // Who is left may not have noticed yet.
        Err(JoinError::Left(_)) => again(net, deadline, JoinError::is_early, once).await,
        result => result,
    }
}

/// The cullers' link between themselves.
async fn link_of_cullers(
    net: &Arc<dyn Net>,
    index: CullerIndex,
    identity: Identity,
    meet: &PeerEndpoint,
    deadline: Instant,
) -> Result<Link, JoinError> {
    let peer = index.other().role();
    match index {
        CullerIndex::First => {
            // The sockets of a session that is over may need a moment to be gone. The display is kept
            // meanwhile.
            let bind = || Listener::bind(net, &meet.endpoint, identity, &meet.options);
            let mut listener = again(net, deadline, ListenError::may_pass, bind).await?;
            let other = listener.accept(deadline).await;
            other.map_err(|cause| JoinError::Accept { peer, cause: Box::new(cause) })
        }
        CullerIndex::Second => {
            let other = connect::<Walkthrough>(net, &meet.endpoint, identity, &meet.options, deadline).await;
            other.map_err(|cause| JoinError::Connect { peer, cause: Box::new(cause) })
        }
    }
}

fn expect_role(link: &Link, due: Role) -> Result<(), JoinError> {
    let came = link.peer.hello.role;
    if came == due { Ok(()) } else { Err(JoinError::Stranger { came, due }) }
}
