//! One machine of the pair at work (paper, algorithm 4.2).

use std::{sync::Arc, time::Duration};

use crate::{FrameEvent, FrameStart, Link};
use tokio::runtime::Handle;
use trimaran_cull::{CullStats, Culler, LodRule, OccluderMapper, View, Viewport};
use trimaran_proto::{Camera, CullCounts, DrawableId, FrameNumber, FrameStats, IdBatch, SentBytes, Settings};
use trimaran_scene::Scene;
use trimaran_transport::Traffic;

use super::{
    OccluderPolicy, RoleError, Turns,
    ids::FrameIds,
    nanoseconds,
    outlet::Outlet,
    parting::{ended, hear_out, leave},
    rule_of,
    stop::{Stop, Waiting},
    stopped_or, wait,
};
use crate::{PairDevice, Seat, Stopwatch, SwitchMachine, SwitchStep};

const DISPLAY: &str = "display";
const OTHER: &str = "other machine of the pair";

/// One machine of the pair, joined to the other two.
#[derive(Debug)]
pub struct PairRole<D> {
    /// Which machine.
    pub seat: Seat,
    /// The scene, the same in all three roles.
    pub scene: Arc<Scene>,
    /// Its device.
    pub device: D,
    /// The link to the display.
    pub display: Link,
    /// The link to the other machine of the pair.
    pub other: Link,
    /// What the display has decided.
    pub settings: Settings,
    /// Which occluders it draws.
    pub occluders: OccluderPolicy,
    /// What it measures its work by. Roles of one process may share it: then their times can be compared.
    pub clock: Stopwatch,
    /// Whether it computes while other roles of the process do.
    pub turns: Turns,
}

impl<D: PairDevice> PairRole<D> {
    /// Plays the role until the session ends, a peer leaves, or `stop` asks. It occupies this thread;
    /// `runtime` drives the links.
    ///
    /// # Errors
    /// When a peer dies, is interrupted or breaks the order, or the device fails. The peers are told before
    /// it returns. That this role itself was asked to stop is no error.
    pub fn run(self, runtime: &Handle, stop: &Stop) -> Result<(), RoleError<D::Error>> {
        let turn = self.turns.of_a_role(self.clock);
        let mut work = Work::new(self, Waiting { runtime, stop, turn: &turn })?;
        work.device.cancel_on(stop);
        let result = stopped_or(work.frames(), stop);
        turn.give_back();
        let result = hear_out(result, [&mut work.display, &mut work.other], work.waiting);
        leave(runtime, [work.display, work.other], &result);
        ended(result, stop)
    }
}

/// What goes on while the role is played.
struct Work<'r, D> {
    machine: SwitchMachine,
    first: FrameNumber,
    device: D,
    display: Link,
    other: Link,
    culler: Culler,
    mapper: Option<OccluderMapper>,
    viewport: Viewport,
    rule: LodRule,
    waiting: Waiting<'r>,
    clock: Stopwatch,
    stats: FrameStats,
    /// All that was sent to the other machine up to the frame before.
    sent_to_other: Traffic,
    /// Time the host spent on the occluders of this frame.
    host: Duration,
    policy: OccluderPolicy,
    /// Ids received of the last frame, and occluders they map to: both for the frame whose occluders are
    /// drawn.
    received: FrameIds,
    due: Vec<DrawableId>,
}

impl<'r, D: PairDevice> Work<'r, D> {
    fn new(role: PairRole<D>, waiting: Waiting<'r>) -> Result<Self, RoleError<D::Error>> {
        let PairRole { seat, scene, device, display, other, settings, occluders, clock, .. } = role;
        let rule = rule_of(&settings)?;
        let received = FrameIds::of(&scene);
        Ok(Self {
            machine: SwitchMachine::new(seat, settings.first, settings.frames),
            first: settings.first,
            device,
            display,
            sent_to_other: other.stats.read().sent,
            other,
            mapper: None,
            culler: Culler::new(scene),
            viewport: settings.size,
            rule,
            waiting,
            clock,
            stats: FrameStats::default(),
            host: Duration::ZERO,
            policy: occluders,
            received,
            due: Vec::new(),
        })
    }

    fn frames(&mut self) -> Result<(), RoleError<D::Error>> {
        loop {
            match self.machine.step() {
                SwitchStep::AwaitCamera { .. } => {
                    let camera = wait(self.waiting, "waiting for a camera", self.display.latest_rx.latest())?;
                    self.machine.camera(camera).map_err(|cause| RoleError::Order { peer: DISPLAY, cause })?;
                }
                SwitchStep::Occlude { camera } => self.draw_occluders(camera)?,
                SwitchStep::Cull { camera, feeds_other } => self.cull(camera, feeds_other)?,
                SwitchStep::Done => return Ok(()),
            }
        }
    }

    /// OR (paper, section 4.2): draws what the other machine finds visible in the frame before, as it comes,
    /// from this frame's camera and at the levels due there.
    fn draw_occluders(&mut self, camera: Camera) -> Result<(), RoleError<D::Error>> {
        loop {
            let event = wait(self.waiting, "receiving occluders", self.other.frames_rx.recv())?;
            let order = |cause| RoleError::Order { peer: OTHER, cause };
            match event {
                FrameEvent::Begin(start) => {
                    self.machine.occluders_began(start.frame).map_err(order)?;
                    self.begin_occluders(camera)?;
                }
                FrameEvent::Batch(batch) => self.take_batch(&batch)?,
                FrameEvent::Note(_) => {}
                FrameEvent::End(_) => {
                    self.machine.occluders_ended().map_err(order)?;
                    return self.complete_occluders(camera);
                }
            }
        }
    }

    /// Begins the turn that ends with the frame's culling.
    fn begin_occluders(&mut self, camera: Camera) -> Result<(), RoleError<D::Error>> {
        self.waiting.turn.take();
        let view = View::new(camera, self.viewport);
        let start = self.clock.elapsed();
        self.stats =
            FrameStats { frame: camera.frame(), or_start_ns: nanoseconds(start), ..FrameStats::default() };
        match &mut self.mapper {
            Some(mapper) => mapper.begin(view, self.rule),
            None => self.mapper = Some(OccluderMapper::new(Arc::clone(self.culler.scene()), view, self.rule)),
        }
        self.device.begin_occluders(&view).map_err(|cause| device("clearing the depth", cause))?;
        self.received.begin();
        self.due.clear();
        self.host = self.clock.elapsed().saturating_sub(start);
        Ok(())
    }

    /// Maps a batch onto this frame's level cut, and draws it if there is nothing to choose.
    fn take_batch(&mut self, batch: &IdBatch) -> Result<(), RoleError<D::Error>> {
        let start = self.clock.elapsed();
        let ids = self.received.take(batch).map_err(|cause| RoleError::Ids { peer: OTHER, cause })?;
        let known = self.due.len();
        if let Some(mapper) = &mut self.mapper {
            mapper.push(ids, &mut self.due)?;
        }
        if self.draws_as_it_comes() {
            self.draw(known)?;
        }
        self.host += self.clock.elapsed().saturating_sub(start);
        Ok(())
    }

    /// All ids are there: chooses among them, and makes up for those that a jump has made useless.
    fn complete_occluders(&mut self, camera: Camera) -> Result<(), RoleError<D::Error>> {
        let start = self.clock.elapsed();
        let view = View::new(camera, self.viewport);
        let scene = Arc::clone(self.culler.scene());
        let drawn = if self.draws_as_it_comes() { self.due.len() } else { 0 };
        self.policy.choose(&scene, &view, self.rule, self.received.ids.len(), &mut self.due);
        self.draw(drawn)?;
        self.host += self.clock.elapsed().saturating_sub(start);
        Ok(())
    }

    /// Whether the device draws while further ids are waited for. A role that waits lets others compute, and
    /// then its device is to be idle.
    const fn draws_as_it_comes(&self) -> bool {
        self.policy.budget.is_none() && !self.waiting.turn.is_exclusive()
    }

    /// Draws the due occluders from this one on.
    fn draw(&mut self, first: usize) -> Result<(), RoleError<D::Error>> {
        let ids = self.due.get(first..).unwrap_or_default();
        self.device.draw_occluders(ids).map_err(|cause| device("drawing occluders", cause))?;
        self.stats.occluders += u32::try_from(ids.len()).unwrap_or(u32::MAX);
        self.stats.occluder_triangles += triangles(self.culler.scene(), ids);
        Ok(())
    }

    /// HC (paper, section 4.1): sends the camera, then each visible drawable as it is decided, then the end.
    fn cull(&mut self, camera: Camera, feeds_other: bool) -> Result<(), RoleError<D::Error>> {
        if camera.frame() == self.first {
            // No frame before it to take occluders from.
            self.begin_occluders(camera)?;
            self.complete_occluders(camera)?;
        }
        let start = self.clock.elapsed();
        let drawing =
            self.device.finish_occluders().map_err(|cause| device("completing the depth", cause))?;
        let or_end = self.clock.elapsed();
        let waited = or_end.saturating_sub(start);
        // What is drawn as it comes may have been drawn before this. What is drawn at once was drawn while
        // the host still worked at it, and that time is counted already.
        let finishing = if self.draws_as_it_comes() { drawing.max(waited) } else { waited };
        self.stats.or_busy_ns = nanoseconds(self.host + finishing);
        self.stats.or_end_ns = nanoseconds(or_end);
        // Only what passes from here on is missing from HC.
        self.waiting.turn.away();

        let view = View::new(camera, self.viewport);
        let other = feeds_other.then_some(&mut self.other.frames_tx);
        let mut outlet = Outlet::new(self.waiting, &mut self.display.frames_tx, other);
        outlet.begin(FrameStart { frame: camera.frame(), header: camera });
        let culled = self.culler.cull(&view, self.rule, &mut self.device, |ids| outlet.push(ids));
        let sent = outlet.finish();
        let walk = culled?;
        sent?;
        self.stats.culling = counts(&walk);
        self.stats.hc_end_ns = nanoseconds(self.clock.elapsed());
        // Work that was interrupted counts as done in one piece, at its end.
        self.stats.hc_start_ns = nanoseconds(or_end + self.waiting.turn.away());
        let sent = self.other.stats.read().sent;
        self.stats.to_other = sent_bytes(sent - std::mem::replace(&mut self.sent_to_other, sent));
        let stats = self.display.frames_tx.note(&self.stats);
        wait(self.waiting, "sending statistics", stats)?;
        self.waiting.turn.give_back();
        self.machine.culled().map_err(|cause| RoleError::Order { peer: OTHER, cause })
    }
}

fn device<D: std::error::Error>(doing: &'static str, cause: D) -> RoleError<D> {
    RoleError::Device { doing, cause }
}

fn triangles(scene: &Scene, ids: &[DrawableId]) -> u64 {
    ids.iter()
        .filter_map(|id| scene.drawables().get(id.index()))
        .map(|drawable| u64::from(drawable.index_count / 3))
        .sum()
}

pub(super) const fn sent_bytes(traffic: Traffic) -> SentBytes {
    SentBytes {
        camera: traffic.latest.bytes,
        begin: traffic.begin.bytes,
        ids: traffic.batches.bytes,
        end: traffic.end.bytes,
        control: traffic.control.bytes,
        headers: traffic.header_bytes,
        messages: traffic.latest.messages
            + traffic.begin.messages
            + traffic.batches.messages
            + traffic.end.messages
            + traffic.control.messages,
    }
}

const fn counts(walk: &CullStats) -> CullCounts {
    CullCounts {
        visited: walk.visited,
        outside: walk.frustum_culled,
        tested: walk.tested,
        hidden: walk.hidden,
        near_visible: walk.near_visible,
        eye_inside: walk.eye_inside,
        not_finite: walk.not_finite,
        few_pixels: walk.stopped_at_few_pixels,
        emitted: walk.emitted,
        refined: walk.refined,
        batches: walk.batches,
    }
}
