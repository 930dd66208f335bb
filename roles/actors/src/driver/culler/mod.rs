//! A culler: which messages move when (paper, algorithm 4.2).
//!
//! | file | what is in it |
//! |---|---|
//! | `mod` | the loop: a camera, its occluders (OR), its visible ids (HC) |
//! | `work` | a culler's work on a frame, and the receivers of its ids |
//! | `inbox` | messages while it waits: cameras, view states, the display's others, the other culler's ids |
//! | `views` | the view states that it received |
//! | `following` | frames of another display that this one follows |
//! | `switch`, `other_frames` | the other culler of the schedule `switch` |

mod following;
mod inbox;
mod other_frames;
mod switch;
mod work;

use std::{mem, panic::AssertUnwindSafe, pin::pin, rc::Rc, sync::Arc};

use futures_util::{FutureExt, future::OptionFuture};
use trimaran_cull::View;
use trimaran_proto::{
    Camera, DrawableId, FrameNumber, FrameStats, RoleMessage, Settings, ViewState, ViewVersion,
};
use trimaran_scene::Scene;

use super::{
    close::{part, worked},
    error::{RoleError, link},
    in_turn::InTurn,
};
use crate::{
    clock::{Stopwatch, nanoseconds},
    leads::Lead,
    limits::Lease,
    links::{FrameStart, Link},
    meeting::Meeting,
    sharing::Sharing,
    stop::Stop,
    supply::CullerEnd,
    turn::Turns,
};

use inbox::{Inbox, Next};
pub use work::{CullerWork, VisibleIds};

/// A culler in a session with a display.
#[derive(Debug)]
pub struct CullerRole<W> {
    /// Its work on a frame.
    pub work: W,
    /// The link to the display.
    pub display: Link,
    /// How it connects to another culler, if the display wants that.
    pub meeting: Meeting,
    /// Its clock, and whether it computes while other roles of the process do.
    pub turns: Turns,
    /// How many drawables the scene has.
    pub drawables: u32,
    /// The scene, for displays that hold none; without it such a display is sent ids alone.
    pub scene: Option<Arc<Scene>>,
    /// The session's part of the limits. Behind the work, whose memory must be freed first.
    pub lease: Lease,
    /// Objects that the service's sessions share.
    pub sharing: Sharing,
}

impl<W: CullerWork> CullerRole<W> {
    /// Plays the role until the display leaves, or `stop` asks. If the work uses a device, it blocks its
    /// thread.
    ///
    /// # Errors
    /// When the display dies, or the device fails. The display is told before it returns. A stop request to
    /// this role is no error.
    pub async fn run(mut self, stop: &Stop) -> Result<(), RoleError> {
        self.work.cancel_on(stop);
        let turn = Rc::new(self.turns.of_a_role());
        let (net, scene) = (&self.meeting.net, &self.scene);
        let bulk = scene.as_ref().and_then(|scene| Some((scene, self.display.bulk.take()?)));
        let supply = bulk.map(|(scene, bulk)| CullerEnd::start(net, bulk, scene, &self.sharing.packed));
        let settings = self.meeting.settings;
        let mut session = Session {
            work: InTurn::new(self.work, &turn),
            inbox: Inbox::new(self.meeting, self.drawables),
            display: self.display,
            lease: self.lease,
            clock: self.turns.clock(),
            settings,
            drawables: self.drawables,
            sharing: self.sharing,
            lead: None,
            supply,
            sent: FrameNumber(0),
            view: ViewVersion(0),
            state: None,
            camera: None,
            last: None,
        };
        // A bug in one session ends only that session.
        let frames = AssertUnwindSafe(session.frames()).catch_unwind();
        let frames = frames.map(|ended| ended.unwrap_or_else(|payload| Err(RoleError::panic(&*payload))));
        let result = worked(turn.given_back_while_waiting(frames), stop).await;
        turn.give_back();
        part(vec![session.into_link().await], result, stop).await
    }
}

struct Session<W> {
    work: InTurn<W>,
    lease: Lease,
    inbox: Inbox,
    display: Link,
    clock: Stopwatch,
    settings: Settings,
    drawables: u32,
    sharing: Sharing,
    /// If other displays may follow this one.
    lead: Option<Lead>,
    supply: Option<CullerEnd>,
    /// The number of the next frame on the display's link.
    sent: FrameNumber,
    /// The view state of the last frame.
    view: ViewVersion,
    state: Option<Arc<ViewState>>,
    /// The camera of the last frame that this display asked for.
    camera: Option<Camera>,
    /// The visible set of the last frame.
    last: Option<(FrameNumber, Vec<DrawableId>)>,
}

/// Where a frame's visible set comes from.
#[derive(Debug, Clone, Copy)]
enum Source<'s> {
    /// This session culls it, with occluders of that frame.
    Culled { occluders_of: Option<FrameNumber> },
    /// Another session has culled it.
    Shared(&'s [DrawableId]),
}

impl<W: CullerWork> Session<W> {
    /// The link to the display, at the end.
    async fn into_link(mut self) -> Link {
        self.inbox.other.part();
        if let Some(supply) = self.supply {
            self.display.bulk = supply.give_back().await;
        }
        self.display
    }

    async fn frames(&mut self) -> Result<(), RoleError> {
        loop {
            self.work.awaits_camera();
            let (camera, state) = tokio::select! {
                biased;
                Some(fault) = OptionFuture::from(self.supply.as_ref().map(CullerEnd::failed)) => {
                    return Err(fault.into());
                }
                next = self.inbox.next(&mut self.display) => match next? {
                    Next::Camera(camera, state) => (camera, state),
                    Next::Lead(leader) => {
                        self.begin_to_lead(leader)?;
                        continue;
                    }
                    Next::Follow(wish) => {
                        self.change_leader(wish).await?;
                        continue;
                    }
                },
            };
            // A newer pose for a frame that had already begun.
            if self.last.as_ref().is_some_and(|(frame, _)| *frame == camera.frame()) {
                continue;
            }
            if mem::replace(&mut self.view, camera.view()) != camera.view() {
                self.lease.change(state.viewport)?;
                self.work.change_view(&state);
            }
            if let Some(supply) = &self.supply
                && self.state.as_ref().is_none_or(|before| !Arc::ptr_eq(before, &state))
            {
                supply.change_view(&state);
            }
            (self.state, self.camera) = (Some(Arc::clone(&state)), Some(camera));
            self.work.has_camera(&camera);
            if let Some(set) = self.shared(camera, &state).await {
                self.work.give_turn_back();
                self.send(camera, Source::Shared(&set)).await?;
                self.tell_followers()?;
                continue;
            }
            let occluders_of = self.occlude(camera).await?;
            self.send(camera, Source::Culled { occluders_of }).await?;
            if let Some((_, ids)) = &self.last {
                self.sharing.sets.put(camera, &state, ids);
            }
            self.tell_followers()?;
        }
    }

    /// The set that another session has culled for the same view. If there is none, waits for it or for this
    /// session's turn to cull. Cullers that feed each other need sets of their own.
    async fn shared(&self, camera: Camera, state: &Arc<ViewState>) -> Option<Arc<[DrawableId]>> {
        if self.inbox.other.is_there() {
            return None;
        }
        let mut turn = pin!(self.work.wait_for_turn());
        loop {
            let next = self.sharing.sets.next();
            if let Some(set) = self.sharing.sets.get(camera, state) {
                return Some(set);
            }
            tokio::select! {
                biased;
                () = &mut turn => return self.sharing.sets.get(camera, state),
                () = next => {}
            }
        }
    }

    /// OR: draws the visible set of the previous frame, from the other culler or this one. Returns that
    /// frame's number.
    async fn occlude(&mut self, camera: Camera) -> Result<Option<FrameNumber>, RoleError> {
        let mut as_they_come = self.inbox.other.feeds(camera.frame());
        if as_they_come {
            as_they_come = self.inbox.begins(&mut self.display, camera.frame()).await?;
        }
        self.work.begin_occluders(camera, as_they_come).await?;
        if as_they_come {
            while let Some(ids) = self.inbox.ids(&mut self.display).await? {
                self.work.take_occluders(&ids)?;
            }
            self.work.complete_occluders(camera).await?;
            return Ok(camera.frame().0.checked_sub(1).map(FrameNumber));
        }
        let occluders_of = self.last.as_ref().map(|(frame, _)| *frame);
        if let Some((_, ids)) = &self.last {
            self.work.take_occluders(ids)?;
        }
        self.work.complete_occluders(camera).await?;
        Ok(occluders_of)
    }

    /// Sends the camera, the frame's visible drawables, and the end. Those that are culled here are sent as
    /// they are decided (HC; paper, section 4.1).
    async fn send(&mut self, camera: Camera, source: Source<'_>) -> Result<(), RoleError> {
        let frame = self.sent;
        self.sent = FrameNumber(frame.0.wrapping_add(1));
        let start = FrameStart { frame, header: camera };
        let other = self.inbox.other.begin(camera).await;
        self.display.frames_tx.begin(start).await.map_err(link("beginning a frame"))?;
        let found = self.last.take().map_or_else(Vec::new, |(_, mut ids)| {
            ids.clear();
            ids
        });
        let view = self.state.as_ref().map(|state| View::of(camera, state));
        let supply = self.supply.as_ref().zip(view);
        let display = Some(&mut self.display.frames_tx);
        let mut visible = VisibleIds { found, display, other, supply, turn: None };
        match source {
            Source::Culled { .. } => self.work.cull(camera, &mut visible).await?,
            Source::Shared(set) => visible.push(set).await?,
        }
        self.last = Some((camera.frame(), mem::take(&mut visible.found)));
        let to_other = self.inbox.other.finish().await;
        self.display.frames_tx.finish().await.map_err(link("ending a frame"))?;
        let observer = self.sharing.observer();
        let stats = match source {
            Source::Culled { occluders_of } => {
                let stats = FrameStats { occluders_of, to_other, ..self.work.frame_stats() };
                observer.inspect(|observer| observer.culled(&stats));
                stats
            }
            Source::Shared(_) => {
                observer.inspect(|observer| observer.shared());
                FrameStats::of_no_work(camera.frame(), nanoseconds(self.clock.elapsed()))
            }
        };
        let message = RoleMessage::Stats(stats);
        self.display.messages_tx.send(&message).await.map_err(link("sending statistics"))
    }
}
