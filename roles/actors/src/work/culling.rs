//! Culling a scene on a device.

use std::{sync::Arc, time::Duration};

use trimaran_cull::{CullStats, Culler, LodRule, OccluderMapper, Rounds, View, Viewport, triangles};
use trimaran_proto::{Camera, CullCounts, DrawableId, FrameStats, IdBatch, RoundCounts, SentBytes, Settings};
use trimaran_scene::Scene;

use super::occluders::OccluderPolicy;
use crate::{
    clock::Stopwatch,
    device::CullerDevice,
    driver::{CullerWork, OTHER, RoleError, VisibleIds},
    ids::FrameIds,
    stop::Stop,
    turn::Turns,
};

/// A culler's work on a scene.
#[derive(Debug)]
pub struct SceneCulling<D> {
    device: D,
    culler: Culler,
    mapper: Option<OccluderMapper>,
    viewport: Viewport,
    rule: LodRule,
    clock: Stopwatch,
    policy: OccluderPolicy,
    /// Whether the device is to be idle while further ids are waited for.
    takes_turns: bool,
    stats: FrameStats,
    /// Time the host spent on the occluders of this frame.
    host: Duration,
    /// When the occluders of this frame were complete.
    or_end: Duration,
    /// Ids received of the last frame, and occluders they map to: both for the frame whose occluders are
    /// drawn.
    received: FrameIds,
    due: Vec<DrawableId>,
}

impl<D: CullerDevice> SceneCulling<D> {
    /// Culls `scene` as the display has decided in `settings`, and measures by the clock of `turns`. A role
    /// that takes turns lets others compute while it waits, and then its device is to be idle.
    pub fn new(scene: &Arc<Scene>, device: D, settings: &Settings, turns: &Turns) -> Self {
        Self {
            device,
            culler: Culler::new(Arc::clone(scene)),
            mapper: None,
            viewport: settings.viewport,
            rule: settings.lod,
            clock: turns.clock(),
            policy: OccluderPolicy::default(),
            takes_turns: turns.are_exclusive(),
            stats: FrameStats::default(),
            host: Duration::ZERO,
            or_end: Duration::ZERO,
            received: FrameIds::of(scene),
            due: Vec::new(),
        }
    }

    /// The same with other occluders than by default.
    #[must_use]
    pub fn with_occluders(self, policy: OccluderPolicy) -> Self {
        Self { policy, ..self }
    }

    /// Whether the device draws while further ids are waited for.
    const fn draws_as_it_comes(&self) -> bool {
        self.policy.budget.is_none() && !self.takes_turns
    }

    /// Draws the due occluders from this one on.
    fn draw(&mut self, first: usize) -> Result<(), RoleError> {
        let ids = self.due.get(first..).unwrap_or_default();
        self.device.draw_occluders(ids).map_err(RoleError::device("drawing occluders"))?;
        self.stats.occluders += count(ids);
        self.stats.occluder_triangles += triangles(self.culler.scene(), ids);
        Ok(())
    }
}

impl<D: CullerDevice> CullerWork for SceneCulling<D> {
    fn cancel_on(&mut self, stop: &Stop) {
        self.device.cancel_on(stop);
    }

    fn begin_occluders(&mut self, camera: Camera) -> Result<(), RoleError> {
        let view = View::new(camera, self.viewport);
        let start = self.clock.elapsed();
        self.stats =
            FrameStats { frame: camera.frame(), or_start_ns: nanoseconds(start), ..FrameStats::default() };
        match &mut self.mapper {
            Some(mapper) => mapper.begin(view, self.rule),
            None => self.mapper = Some(OccluderMapper::new(Arc::clone(self.culler.scene()), view, self.rule)),
        }
        self.device.begin_occluders(&view).map_err(RoleError::device("clearing the depth"))?;
        self.received.begin();
        self.due.clear();
        self.host = self.clock.elapsed().saturating_sub(start);
        Ok(())
    }

    /// Maps a batch onto this frame's LOD cut, and draws it if there is nothing to choose.
    fn take_occluders(&mut self, batch: &IdBatch) -> Result<(), RoleError> {
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

    /// Chooses among the ids, and makes up for those that a jump has made useless.
    async fn complete_occluders(&mut self, camera: Camera) -> Result<(), RoleError> {
        let start = self.clock.elapsed();
        let view = View::new(camera, self.viewport);
        let drawn = if self.draws_as_it_comes() { self.due.len() } else { 0 };
        let received = self.received.ids.len();
        self.policy.choose(self.culler.scene(), &view, self.rule, received, &mut self.due);
        self.draw(drawn)?;
        self.host += self.clock.elapsed().saturating_sub(start);
        let start = self.clock.elapsed();
        let drawing = self.device.finish_occluders().map_err(RoleError::device("completing the depth"))?;
        self.or_end = self.clock.elapsed();
        let waited = self.or_end.saturating_sub(start);
        // What is drawn as it comes may have been drawn before this. What is drawn at once was drawn while
        // the host still worked at it, and that time is counted already.
        let finishing = if self.draws_as_it_comes() { drawing.max(waited) } else { waited };
        self.stats.or_busy_ns = nanoseconds(self.host + finishing);
        self.stats.or_end_ns = nanoseconds(self.or_end);
        Ok(())
    }

    async fn cull(&mut self, camera: Camera, visible: &mut VisibleIds<'_>) -> Result<(), RoleError> {
        let Some(last) = &self.mapper else { return Ok(()) };
        let view = View::new(camera, self.viewport);
        let scene = Arc::clone(self.culler.scene());
        let traversal = self.culler.traverse(&view, self.rule, &self.device)?;
        let mut rounds = Rounds::new(traversal, last, &self.due, self.policy.rule());
        let (clock, mut drawing) = (&self.clock, Duration::ZERO);
        let mut add_occluders = |device: &mut D, ids: &[DrawableId]| {
            let start = clock.elapsed();
            device.add_occluders(ids)?;
            drawing += clock.elapsed().saturating_sub(start);
            Ok(())
        };
        while let Some(ids) = rounds.next(&mut self.device, &mut add_occluders)? {
            visible.push(ids).await?;
        }
        let stats = rounds.stats();
        self.stats.culling = counts(&stats);
        self.stats.rounds = RoundCounts {
            further: rounds.rounds().saturating_sub(1),
            occluder_triangles: triangles(&scene, rounds.occluders()),
            drawing_ns: nanoseconds(drawing),
            tested: stats.tested_again,
            hidden: stats.hidden_later,
        };
        self.stats.occluders += count(rounds.occluders());
        self.stats.occluder_triangles += self.stats.rounds.occluder_triangles;
        Ok(())
    }

    fn frame_stats(&mut self, to_other: SentBytes, away: Duration) -> FrameStats {
        self.stats.hc_end_ns = nanoseconds(self.clock.elapsed());
        // Work that was interrupted counts as done in one piece, at its end.
        self.stats.hc_start_ns = nanoseconds(self.or_end + away);
        self.stats.to_other = to_other;
        self.stats
    }
}

fn count(ids: &[DrawableId]) -> u32 {
    u32::try_from(ids.len()).unwrap_or(u32::MAX)
}

fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
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
