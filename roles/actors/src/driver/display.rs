//! The display: deals cameras, and shows frames as they come (paper, algorithm 4.3).

use std::{
    future::{Future, ready},
    rc::Rc,
    sync::Arc,
    time::Duration,
};

use trimaran_cull::Image;
use trimaran_proto::{Camera, DrawableId, FrameNumber, SessionKey, Settings, ViewState};
use trimaran_scene::Scene;
use trimaran_transport::Net;

use super::{error::RoleError, in_turn::InTurn};
use crate::{
    deal::{Pace, Schedule},
    peers::Peers,
    stop::Stop,
    turn::{Turn, Turns},
};

/// A display's work on a frame: on a device, or as recorded.
pub trait DisplayWork {
    /// As [`CullerDevice::cancel_on`](crate::CullerDevice::cancel_on).
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// Uses another view state from the next frame on.
    fn change_view(&mut self, state: &ViewState) {
        let _ = state;
    }

    /// Whether [`draw`](Self::draw) ends when the picture is drawn, so that its time says what drawing costs.
    fn draws_at_once(&self) -> bool {
        true
    }

    /// A frame is to be drawn: waits until the device is free for it.
    fn begin_frame(&mut self) -> impl Future<Output = ()> {
        ready(())
    }

    /// Draws a frame (RVG). `missing` is how many of its ids were lost on a link with deadlines. It may
    /// reorder `ids`, and add others for the lost ones: returns how many.
    ///
    /// # Errors
    /// Those of the device.
    fn draw(
        &mut self,
        camera: Camera,
        ids: &mut Vec<DrawableId>,
        missing: u32,
    ) -> impl Future<Output = Result<usize, RoleError>>;

    /// The device's time for the picture drawn last, measured by its own timestamps. Zero if it has none.
    fn device_time(&self) -> Duration {
        Duration::ZERO
    }

    /// The picture drawn last.
    ///
    /// # Errors
    /// Those of the device.
    fn picture(&mut self) -> Result<Option<&Image>, RoleError>;

    /// The frame has been shown.
    fn end_frame(&mut self) {}
}

/// How a live display without a scene shows an incomplete frame. In lockstep it always waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WhileLoading {
    /// Coarser drawables as stand-ins for missing ones. They are sent first.
    #[default]
    Coarser,
    /// Waits until all of the frame has arrived.
    Wait,
}

/// A scene that its cullers supply to a display.
#[derive(Debug, Clone)]
pub struct Supplied {
    /// The scene, [empty](Scene::empty) at first.
    pub scene: Arc<Scene>,
    /// The size limit of packed geometry beside that of the current frame, bytes.
    pub memory: u64,
    /// How an incomplete frame is shown.
    pub while_loading: WhileLoading,
}

/// A display and its cullers.
#[derive(Debug)]
pub struct DisplayRole<W, A> {
    /// Its work on a frame.
    pub work: W,
    /// Its own culling, for frames without a culler. Without it such a frame waits for a culler.
    pub alone: Option<A>,
    /// The supplied scene, if it holds none.
    pub supplied: Option<Supplied>,
    /// The cullers.
    pub cullers: Peers,
    /// Identifies the session to cullers.
    pub session: SessionKey,
    /// The settings from the handshake with the cullers.
    pub settings: Settings,
    /// How frames are distributed.
    pub schedule: Schedule,
    /// The frames.
    pub pace: Pace,
    /// The first frame: above 0 if a walk is resumed.
    pub first: FrameNumber,
    /// How long it waits at the start for the cullers that it connects to. Then it begins without the missing
    /// ones, and keeps trying them.
    pub join_timeout: Duration,
    /// How many drawables the scene has.
    pub drawables: u32,
    /// The network and clock.
    pub net: Arc<dyn Net>,
    /// Its clock, and whether it draws while other roles of the process compute.
    pub turns: Turns,
}

impl<W, A> DisplayRole<W, A> {
    /// The same role, whose work waits for its `turn`.
    pub(super) fn in_turn(self, turn: &Rc<Turn>) -> DisplayRole<InTurn<W>, InTurn<A>> {
        let Self { work, alone, supplied, cullers, session, settings, schedule, pace, .. } = self;
        let Self { first, join_timeout, drawables, net, turns, .. } = self;
        DisplayRole {
            work: InTurn::new(work, turn),
            alone: alone.map(|alone| InTurn::new(alone, turn)),
            supplied,
            cullers,
            session,
            settings,
            schedule,
            pace,
            first,
            join_timeout,
            drawables,
            net,
            turns,
        }
    }

    /// A display that walks in lockstep as long as there are cameras, with independent cullers. It culls
    /// nothing itself, waits for no culler at the start, and computes beside other roles. Set other fields
    /// with `DisplayRole { pace, ..DisplayRole::new(..) }`.
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
