//! Three roles find each other, over whatever transports their endpoints name. Start order does not matter: whoever connects tries again until the deadline.

use std::sync::Arc;

use thiserror::Error;
use trimaran_proto::{Identity, Role, SceneHash, Settings};
use trimaran_transport::{
    AcceptError, ConnectError, Endpoint, Instant, Link, ListenError, Listener, Net, Options, connect,
};

use crate::Seat;

/// Why a role did not find the others.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum JoinError {
    /// The role cannot listen.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// A peer did not come.
    #[error("waiting for {peer} failed")]
    Accept {
        /// The peer that was missing.
        peer: Role,
        /// Why.
        #[source]
        cause: Box<AcceptError>,
    },
    /// A peer cannot be reached, or refuses.
    #[error("joining {peer} failed")]
    Connect {
        /// The peer.
        peer: Role,
        /// Why.
        #[source]
        cause: Box<ConnectError>,
    },
    /// A peer came that has no place here.
    #[error("{came} came where {due} was due; check the roles and addresses in the configurations")]
    Stranger {
        /// Who came.
        came: Role,
        /// Who was due.
        due: Role,
    },
    /// The display's address belongs to something that dictates no session.
    #[error("the peer at the display's address dictates no session")]
    NoSettings,
}

impl JoinError {
    /// Whether it may work another time though nothing is changed: a peer was not there in time, or holds the place of a process that is
    /// gone for this one's. Any other failure is about what one of the roles was given.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Accept { .. } => true,
            Self::Connect { cause, .. } => cause.may_pass(),
            Self::Listen(_) | Self::Stranger { .. } | Self::NoSettings => false,
        }
    }
}

/// The role on the wire of a machine of the pair.
#[must_use]
pub const fn role_of(seat: Seat) -> Role {
    match seat {
        Seat::First => Role::SwitchA,
        Seat::Second => Role::SwitchB,
    }
}

/// The display waits for both machines of the pair on its listener; the links come first machine first.
///
/// # Errors
/// When one has not come by the deadline.
pub async fn await_pair(mut listener: Listener, deadline: Instant) -> Result<[Link; 2], JoinError> {
    let (mut first, mut second) = (None, None);
    loop {
        let missing = if first.is_none() { Role::SwitchA } else { Role::SwitchB };
        let link = listener
            .accept(deadline)
            .await
            .map_err(|cause| JoinError::Accept { peer: missing, cause: Box::new(cause) })?;
        match link.peer.identity.role {
            Role::SwitchA => first = Some(link),
            Role::SwitchB => second = Some(link),
            came @ Role::Display => return Err(JoinError::Stranger { came, due: missing }),
        }
        match (first.take(), second.take()) {
            (Some(first), Some(second)) => return Ok([first, second]),
            (early_first, early_second) => (first, second) = (early_first, early_second),
        }
    }
}

/// What a machine of the pair has once it has joined.
#[derive(Debug)]
pub struct Joined {
    /// The link to the display.
    pub display: Link,
    /// The link to the other machine of the pair.
    pub other: Link,
    /// What the display dictates.
    pub settings: Settings,
}

/// Where a role meets another, and what holds for their link.
#[derive(Debug, Clone)]
pub struct Place {
    /// Where.
    pub endpoint: Endpoint,
    /// How, and whom it expects there.
    pub options: Options,
}

/// A machine of the pair joins the display at `display` and the other machine: the first listens at `pair`, the second
/// connects there. The two links may go over different transports.
///
/// # Errors
/// When a peer is not there by the deadline, refuses, or is not who it should be.
pub async fn join_session(
    net: &Arc<dyn Net>,
    seat: Seat,
    scene: SceneHash,
    display: &Place,
    pair: &Place,
    deadline: Instant,
) -> Result<Joined, JoinError> {
    let role = role_of(seat);
    let identity = |settings| Identity { role, scene, settings };
    let display = connect(net, &display.endpoint, identity(None), &display.options, deadline)
        .await
        .map_err(|cause| JoinError::Connect { peer: Role::Display, cause: Box::new(cause) })?;
    expect_role(&display, Role::Display)?;
    let settings = display.peer.identity.settings.ok_or(JoinError::NoSettings)?;
    let peer = role_of(seat.other());
    let other = match seat {
        Seat::First => {
            let mut listener =
                Listener::bind(net, &pair.endpoint, identity(Some(settings)), &pair.options).await?;
            listener
                .accept(deadline)
                .await
                .map_err(|cause| JoinError::Accept { peer, cause: Box::new(cause) })?
        }
        Seat::Second => connect(net, &pair.endpoint, identity(Some(settings)), &pair.options, deadline)
            .await
            .map_err(|cause| JoinError::Connect { peer, cause: Box::new(cause) })?,
    };
    expect_role(&other, peer)?;
    Ok(Joined { display, other, settings })
}

fn expect_role(link: &Link, due: Role) -> Result<(), JoinError> {
    let came = link.peer.identity.role;
    if came == due { Ok(()) } else { Err(JoinError::Stranger { came, due }) }
}
