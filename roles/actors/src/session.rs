//! A culler finds the others, plays, and goes on with them after one was lost.

use std::{error::Error, io, sync::Arc, time::Duration};

use thiserror::Error;
use trimaran_proto::{SceneHash, Settings};
use trimaran_transport::{ListenError, Net};

use crate::{
    driver::{CullerRole, CullerWork, RoleError, leave_unable},
    join::{JoinError, Joined, PeerEndpoint, again, join_session},
    machine::CullerIndex,
    stop::Stop,
    turn::Turns,
};

/// How long a role waits for the others.
#[derive(Debug, Clone, Copy)]
pub struct JoinTimeouts {
    /// At first.
    pub join: Duration,
    /// After one was lost; not at all if zero.
    pub rejoin: Duration,
}

impl JoinTimeouts {
    /// Long enough to load and copy a large scene. Who was lost is not waited for.
    pub const ONCE: Self = Self { join: Duration::from_secs(120), rejoin: Duration::ZERO };
}

/// Why a role could not take part in a session to its end.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The system gave it no thread.
    #[error("cannot start a thread for a role")]
    Thread(#[source] io::Error),
    /// It cannot listen.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// It did not find the others.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// It ended early.
    #[error(transparent)]
    Role(#[from] RoleError),
    /// A peer was lost, and did not come again.
    #[error("a peer was lost, and the session could not go on within {} s", .within.as_secs_f64())]
    Lost {
        /// How long the role waited.
        within: Duration,
        /// How it was lost.
        #[source]
        cause: RoleError,
    },
    /// A culler of the same process could not.
    #[error("the {} failed", .index.name())]
    Culler {
        /// Which.
        index: CullerIndex,
        /// Why.
        #[source]
        cause: Box<Self>,
    },
}

/// A culler in a session, `work` of which gives what it does with a frame.
#[expect(missing_debug_implementations, reason = "closures say nothing")]
pub struct CullerSession<F, E> {
    /// Which culler.
    pub index: CullerIndex,
    /// The scene, the same in all three roles.
    pub scene: SceneHash,
    /// The time it waits by.
    pub net: Arc<dyn Net>,
    /// Where the display is.
    pub display: PeerEndpoint,
    /// Where the cullers meet.
    pub other: PeerEndpoint,
    /// How long it waits for the others.
    pub timeouts: JoinTimeouts,
    /// As in [`CullerRole`].
    pub turns: Turns,
    /// Makes ready for what the display has decided.
    pub work: F,
    /// Told how the session goes.
    pub watch: E,
}

/// What a culler's process may want to show of its session.
#[derive(Debug)]
pub enum SessionEvent<'e> {
    /// All have joined, over these links.
    Joined(&'e Joined),
    /// A peer was lost, and is waited for.
    Lost(&'e (dyn Error + 'static)),
}

impl<W, F, E> CullerSession<F, E>
where
    W: CullerWork,
    F: FnMut(&Settings) -> Result<W, RoleError>,
    E: FnMut(SessionEvent<'_>),
{
    /// Joins the others and plays until the session ends, or `stop` asks. When a peer is lost that may come
    /// again, all join anew, and the session goes on.
    ///
    /// # Errors
    /// When the others are not there in time, and as the role does.
    pub async fn run(mut self, stop: &Stop) -> Result<(), SessionError> {
        let (mut within, mut lost) = (self.timeouts.join, None);
        loop {
            let deadline = self.net.now().after(within);
            let Self { index, scene, net, display, other, .. } = &self;
            let join = || join_session(net, *index, *scene, display, other, deadline);
            let joining = again(net, deadline, JoinError::is_early, join);
            let Some(joined) = stop.unless_requested(joining).await else { return Ok(()) };
            let joined = joined.map_err(|error| match lost.take() {
                Some(cause) => SessionError::Lost { within, cause },
                None => error.into(),
            })?;
            match self.play(joined, stop).await {
                Err(error) if !self.timeouts.rejoin.is_zero() && error.lost_a_peer() => {
                    (self.watch)(SessionEvent::Lost(&error));
                    (within, lost) = (self.timeouts.rejoin, Some(error));
                }
                played => return Ok(played?),
            }
        }
    }

    async fn play(&mut self, joined: Joined, stop: &Stop) -> Result<(), RoleError> {
        (self.watch)(SessionEvent::Joined(&joined));
        let Joined { display, other, settings } = joined;
        match (self.work)(&settings) {
            Ok(work) => {
                let (index, turns) = (self.index, self.turns.clone());
                CullerRole { index, work, display, other, settings, turns }.run(stop).await
            }
            Err(error) => Err(leave_unable([display, other], error).await),
        }
    }
}
