//! A role finds the others, plays, and goes on with them after one was lost.

use std::{error::Error, future::Future, io, sync::Arc, time::Duration};

use thiserror::Error;
use trimaran_proto::{SceneHash, Settings};
use trimaran_transport::{Instant, Net};

use crate::{
    clock::Stopwatch,
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

/// A peer was lost for good. `D` is the error of the role's device.
#[derive(Debug, Error)]
#[error("a peer was lost, and the session could not go on within {} s", .within.as_secs_f64())]
pub struct LostForGood<D: Error + 'static> {
    /// How long the role waited.
    pub within: Duration,
    /// How it was lost.
    #[source]
    pub lost: RoleError<D>,
}

/// A role that takes part in a session: see [`take_part`].
pub trait Participant {
    /// The links to the others.
    type Links;
    /// Why its device failed.
    type Device: Error + 'static;
    /// Why it could not take part to the end.
    type Failure: From<RoleError<Self::Device>> + From<LostForGood<Self::Device>>;

    /// Joins the others.
    ///
    /// # Errors
    /// When one is not there by the deadline.
    fn join(&mut self, deadline: Instant) -> impl Future<Output = Result<Self::Links, Self::Failure>>;

    /// Plays the role until the session ends.
    ///
    /// # Errors
    /// As the role does.
    fn play(
        &mut self,
        links: Self::Links,
        stop: &Stop,
    ) -> impl Future<Output = Result<(), RoleError<Self::Device>>>;

    /// A peer was lost, and is waited for. Whether there is anything left to play.
    fn lost(&mut self, error: &RoleError<Self::Device>) -> bool;
}

/// Joins the others and plays until the session ends, or `stop` asks. When a peer is lost that may come again,
/// all join anew, and the session goes on.
///
/// # Errors
/// When the others are not there in time, and as the role does.
pub async fn take_part<P: Participant>(
    participant: &mut P,
    net: &Arc<dyn Net>,
    timeouts: JoinTimeouts,
    stop: &Stop,
) -> Result<(), P::Failure> {
    let (mut within, mut lost) = (timeouts.join, None);
    loop {
        let joining = participant.join(net.now().after(within));
        let Some(links) = stop.unless_requested(joining).await else { return Ok(()) };
        let links = match (links, lost.take()) {
            (Ok(links), _) => links,
            (Err(_), Some(lost)) => return Err(LostForGood { within, lost }.into()),
            (Err(failure), None) => return Err(failure),
        };
        match participant.play(links, stop).await {
            Err(error) if !timeouts.rejoin.is_zero() && error.lost_a_peer() => {
                if !participant.lost(&error) {
                    return Ok(());
                }
                (within, lost) = (timeouts.rejoin, Some(error));
            }
            result => return Ok(result?),
        }
    }
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
    pub clock: Stopwatch,
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

/// Why a culler could not take part to the end.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CullerError<D: Error + 'static> {
    /// The system gave it no thread.
    #[error("cannot start a thread for it")]
    Thread(#[source] io::Error),
    /// It did not find the others.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// It ended early.
    #[error(transparent)]
    Role(#[from] RoleError<D>),
    /// A peer did not come again.
    #[error(transparent)]
    Lost(#[from] LostForGood<D>),
}

impl<W, F, E> CullerSession<F, E>
where
    W: CullerWork,
    F: FnMut(&Settings) -> Result<W, RoleError<W::Error>>,
    E: FnMut(SessionEvent<'_>),
{
    /// Takes part until the session ends, or `stop` asks: see [`take_part`].
    ///
    /// # Errors
    /// When the others are not there in time, and as the role does.
    pub async fn run(mut self, stop: &Stop) -> Result<(), CullerError<W::Error>> {
        let (net, timeouts) = (Arc::clone(&self.net), self.timeouts);
        take_part(&mut self, &net, timeouts, stop).await
    }
}

impl<W, F, E> Participant for CullerSession<F, E>
where
    W: CullerWork,
    F: FnMut(&Settings) -> Result<W, RoleError<W::Error>>,
    E: FnMut(SessionEvent<'_>),
{
    type Links = Joined;
    type Device = W::Error;
    type Failure = CullerError<W::Error>;

    async fn join(&mut self, deadline: Instant) -> Result<Joined, CullerError<W::Error>> {
        let Self { index, scene, net, display, other, .. } = &*self;
        let join = || join_session(net, *index, *scene, display, other, deadline);
        Ok(again(net, deadline, JoinError::is_early, join).await?)
    }

    async fn play(&mut self, joined: Joined, stop: &Stop) -> Result<(), RoleError<W::Error>> {
        (self.watch)(SessionEvent::Joined(&joined));
        let Joined { display, other, settings } = joined;
        match (self.work)(&settings) {
            Ok(work) => {
                let (index, clock, turns) = (self.index, self.clock, self.turns.clone());
                CullerRole { index, work, display, other, settings, clock, turns }.run(stop).await
            }
            Err(error) => Err(leave_unable([display, other], error).await),
        }
    }

    fn lost(&mut self, error: &RoleError<W::Error>) -> bool {
        (self.watch)(SessionEvent::Lost(error));
        true
    }
}
