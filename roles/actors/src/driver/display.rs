//! The display: deals cameras, and shows frames as they come (paper, algorithm 4.3).

use std::{future::Future, sync::Arc, time::Duration};

use trimaran_cull::Image;
use trimaran_proto::{Camera, DrawableId, FrameNumber, SessionKey, Settings, ViewState};
use trimaran_scene::Scene;
use trimaran_transport::Net;

use super::error::RoleError;
use crate::{
    deal::{Pace, Schedule},
    peers::Peers,
    stop::Stop,
    turn::Turns,
};

/// What a display does with a frame: on a device, or as it was recorded.
pub trait DisplayWork {
    /// As [`CullerDevice::cancel_on`](crate::CullerDevice::cancel_on).
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// From the next frame on, another view state holds.
    fn change_view(&mut self, state: &ViewState) {
        let _ = state;
    }

    /// Draws a frame (RVG). Of its `ids` so many are `missing`, lost on a link with deadlines. They may be
    /// put into another order, and others may be added for those that were lost: it says how many.
    ///
    /// # Errors
    /// As the device says.
    fn draw(
        &mut self,
        camera: Camera,
        ids: &mut Vec<DrawableId>,
        missing: u32,
    ) -> impl Future<Output = Result<usize, RoleError>>;

    /// The picture drawn last.
    ///
    /// # Errors
    /// As the device says.
    fn picture(&mut self) -> Result<Option<&Image>, RoleError>;
}

/// What a live display that has no scene shows of a frame, while some of it is still to come. In lockstep it
/// always waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WhileLoading {
    /// Coarser drawables in the place of what is still to come, which are sent first.
    #[default]
    Coarser,
    /// Nothing: it waits until all of the frame has come.
    Wait,
}

/// A scene that a display is supplied by its cullers.
#[derive(Debug, Clone)]
pub struct Supplied {
    /// The scene, [empty](Scene::empty) at first.
    pub scene: Arc<Scene>,
    /// The most bytes of packed geometry that are kept beside what the frame under way needs.
    pub memory: u64,
    /// What is shown while some of a frame is still to come.
    pub while_loading: WhileLoading,
}

/// A display and its cullers.
#[derive(Debug)]
pub struct DisplayRole<W, A> {
    /// What it does with a frame.
    pub work: W,
    /// How it culls a frame itself, where no culler does. Without it such a frame waits for a culler.
    pub alone: Option<A>,
    /// Where it holds no scene: what it is supplied.
    pub supplied: Option<Supplied>,
    /// The cullers.
    pub cullers: Peers,
    /// How the session is known to cullers.
    pub session: SessionKey,
    /// What the cullers were told in the handshake.
    pub settings: Settings,
    /// How frames are dealt.
    pub schedule: Schedule,
    /// Which frames there are.
    pub pace: Pace,
    /// The frame that comes first: above 0 where a walk goes on.
    pub first: FrameNumber,
    /// How long it waits at the start for all cullers that it connects to. Then it begins with those that
    /// are there, and goes on looking for the others.
    pub join_timeout: Duration,
    /// How many drawables the scene has.
    pub drawables: u32,
    /// The time it waits by.
    pub net: Arc<dyn Net>,
    /// What it measures by, and whether it draws while other roles of the process compute.
    pub turns: Turns,
}

impl<W, A> DisplayRole<W, A> {
    /// A display that walks in lockstep as long as there are cameras, with independent cullers. It culls
    /// nothing itself, waits for no culler at the start, and computes beside other roles. Name what is
    /// different: `DisplayRole { pace, ..DisplayRole::new(..) }`.
    #[must_use]
    pub fn new(
        work: W,
        cullers: Peers,
        session: SessionKey,
        settings: Settings,
        drawables: u32,
        net: &Arc<dyn Net>,
    ) -> Self {
        Self {
            work,
            alone: None,
            supplied: None,
            cullers,
            session,
            settings,
            schedule: Schedule::default(),
            pace: Pace::Lockstep { frames: None },
            first: FrameNumber(0),
            join_timeout: Duration::ZERO,
            drawables,
            net: Arc::clone(net),
            turns: Turns::at_once(),
        }
    }
}
