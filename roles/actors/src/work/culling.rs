//! Culling a scene on a device.

use std::{sync::Arc, time::Duration};

use trimaran_cull::{
    CullError, Culler, CutRule, DrawOrder, OccluderMapper, Rounds, TriangleBudget, View, lod_cut,
    select_occluders, triangles,
};
use trimaran_proto::{Camera, DrawableId, FrameNumber, FrameStats, RoundCounts, Settings, ViewState};
use trimaran_scene::Scene;

use super::{
    costs::Costs,
    occluders::{OccluderPolicy, map},
    pieces::{InPieces, Pieces},
};
use crate::{
    clock::{Stopwatch, nanoseconds},
    device::CullerDevice,
    driver::{CullerWork, RoleError, VisibleIds},
    stop::Stop,
    turn::Turns,
};

/// A culler's work on a scene.
#[derive(Debug)]
pub struct SceneCulling<D> {
    device: D,
    culler: Culler,
    mapper: Option<OccluderMapper>,
    state: ViewState,
    rule: CutRule,
    /// Of the current frame.
    view: View,
    clock: Stopwatch,
    policy: OccluderPolicy,
    pieces: Pieces,
    /// Whether the device is to be idle while the role waits for further ids.
    idle_while_waiting: bool,
    /// Whether the occluders of this frame are chosen as they come. They are drawn then, too, unless the
    /// device is to be idle.
    as_they_come: bool,
    /// The remaining triangle budget in that case.
    left: u64,
    stats: FrameStats,
    /// The host's time for the occluders of this frame.
    host: Duration,
    /// How many ids of an earlier frame have come for this one, and the occluders mapped from them.
    received: usize,
    due: Vec<DrawableId>,
    /// All that were mapped, ascending, if they came at once.
    mapped: Vec<DrawableId>,
    order: DrawOrder,
}

impl<D: CullerDevice> SceneCulling<D> {
    /// Culls `scene` with the display's `settings`, and measures by the clock of `turns`. A role in turn lets
    /// others compute while it waits, and its device must be idle then.
    pub fn new(scene: &Arc<Scene>, device: D, settings: &Settings, turns: &Turns) -> Self {
        Self::with(scene, device, settings, turns, OccluderPolicy::default())
    }

    /// The same with occluders chosen by `policy`.
    pub fn with(
        scene: &Arc<Scene>,
        device: D,
        settings: &Settings,
        turns: &Turns,
        policy: OccluderPolicy,
    ) -> Self {
        Self {
            device,
            culler: Culler::new(Arc::clone(scene)),
            mapper: None,
            state: (*settings).into(),
            rule: CutRule::new(scene, &(*settings).into()),
            view: View::new(Camera::at_origin(FrameNumber(0)), settings.viewport),
            clock: turns.clock(),
            policy,
            pieces: Pieces::default(),
            idle_while_waiting: turns.idle_devices(),
            as_they_come: false,
            left: 0,
            stats: FrameStats::default(),
            host: Duration::ZERO,
            received: 0,
            due: Vec::new(),
            mapped: Vec::new(),
            order: DrawOrder::default(),
        }
    }

    /// Draws the due occluders from this one on.
    fn draw(&mut self, first: usize) -> Result<(), RoleError> {
        let ids = self.due.get_mut(first..).unwrap_or_default();
        self.order.sort(self.culler.scene(), &self.view, ids);
        self.device.draw_occluders(ids).map_err(RoleError::of_device::<D>("drawing occluders"))?;
        self.stats.occluders += count(ids);
        self.stats.occluder_triangles += triangles(self.culler.scene(), ids);
        Ok(())
    }

    /// Adds the device's times since the last call to the frame's.
    fn take_times(&mut self) -> Result<(), RoleError> {
        let times = self.device.take_times().map_err(RoleError::of_device::<D>("reading its times"))?;
        self.stats.device = self.stats.device + times;
        Ok(())
    }
}

impl<D: CullerDevice> CullerWork for SceneCulling<D> {
    fn cancel_on(&mut self, stop: &Stop) {
        self.device.cancel_on(&stop.cancel());
    }

    fn change_view(&mut self, state: &ViewState) {
        self.rule = CutRule::new(self.culler.scene(), state);
        self.device.change_occlusion_test(state.occlusion_test);
        self.state = state.clone();
    }

    async fn begin_occluders(&mut self, camera: Camera, as_they_come: bool) -> Result<(), RoleError> {
        let view = View::of(camera, &self.state).on_grid(self.device.grid());
        self.view = view;
        let start = self.clock.elapsed();
        self.stats =
            FrameStats { frame: camera.frame(), or_start_ns: nanoseconds(start), ..FrameStats::default() };
        match &mut self.mapper {
            Some(mapper) => mapper.begin(view, &self.rule),
            None => {
                self.mapper = Some(OccluderMapper::new(Arc::clone(self.culler.scene()), view, &self.rule));
            }
        }
        self.device.begin_occluders(&view).map_err(RoleError::of_device::<D>("clearing the depth"))?;
        self.received = 0;
        self.due.clear();
        self.mapped.clear();
        self.as_they_come = as_they_come;
        self.left = self.policy.budget.0;
        self.host = self.clock.elapsed().saturating_sub(start);
        Ok(())
    }

    /// Maps ids onto this frame's LOD cut. If they come bit by bit, takes the best occluders of each part,
    /// within half of the remaining budget: the first ids are of large or distant nodes, and more may come.
    fn take_occluders(&mut self, ids: &[DrawableId]) -> Result<(), RoleError> {
        let start = self.clock.elapsed();
        self.received += ids.len();
        let known = self.due.len();
        let Some(mapper) = &mut self.mapper else { return Ok(()) };
        if self.as_they_come {
            mapper.push(ids, &mut self.due)?;
            let mut chosen = self.due.split_off(known);
            self.mapped.extend_from_slice(&chosen);
            let scene = self.culler.scene();
            self.rule.retain_solid(scene, &mut chosen);
            select_occluders(scene, &self.view, &mut chosen, TriangleBudget(self.left / 2));
            self.left -= triangles(scene, &chosen).min(self.left);
            self.due.extend(chosen);
            if !self.idle_while_waiting {
                self.draw(known)?;
            }
        } else {
            self.mapped = map(&mut self.device, mapper, (&self.view, &self.rule), ids)?;
            self.due.extend_from_slice(&self.mapped);
        }
        self.host += self.clock.elapsed().saturating_sub(start);
        Ok(())
    }

    /// Chooses among the ids, and replaces those that a jump has made useless.
    async fn complete_occluders(&mut self, _: Camera) -> Result<(), RoleError> {
        let start = self.clock.elapsed();
        let drawn = if self.as_they_come && !self.idle_while_waiting { self.due.len() } else { 0 };
        let scene = Arc::clone(self.culler.scene());
        if self.as_they_come {
            self.mapped.sort_unstable();
            if self.policy.is_useless(self.mapped.len(), self.received) {
                let budget = TriangleBudget(self.left);
                let mut large = OccluderPolicy::large(&scene, &self.view, &self.rule, budget);
                large.retain(|id| !self.due.contains(id));
                self.due.append(&mut large);
            }
        } else {
            self.policy.choose(&scene, &self.view, &self.rule, self.received, &mut self.due);
        }
        self.draw(drawn)?;
        self.host += self.clock.elapsed().saturating_sub(start);
        let start = self.clock.elapsed();
        let completed = if self.idle_while_waiting {
            self.device.finish_occluders()
        } else {
            self.device.submit_occluders()
        };
        completed.map_err(RoleError::of_device::<D>("completing the depth"))?;
        let or_end = self.clock.elapsed();
        let waited = or_end.saturating_sub(start);
        // Occluders drawn as they come may have been drawn before this. Otherwise they were drawn while the
        // host still worked on them, and that time is counted already.
        if self.as_they_come && !self.idle_while_waiting {
            self.take_times()?;
        }
        let finishing = nanoseconds(waited).max(self.stats.device.drawing_ns);
        self.stats.or_busy_ns = nanoseconds(self.host) + finishing;
        self.stats.or_end_ns = nanoseconds(or_end);
        Ok(())
    }

    async fn cull(&mut self, _: Camera, visible: &mut VisibleIds<'_>) -> Result<(), RoleError> {
        let scene = Arc::clone(self.culler.scene());
        let traversal = self.culler.traverse(&self.view, &self.rule, &self.device);
        let traversal = traversal.map_err(RoleError::of_culling::<D>)?;
        let mut rounds = Rounds::new(traversal, &self.mapped, &self.due, self.policy.rule());
        let (clock, mut drawing) = (self.clock, Duration::ZERO);
        let mut add_occluders = |test: &mut InPieces<'_, D>, ids: &[DrawableId]| {
            let start = clock.elapsed();
            test.device.add_occluders(ids)?;
            drawing += clock.elapsed().saturating_sub(start);
            Ok(())
        };
        let Self { device, pieces, .. } = self;
        let mut test = InPieces { device, pieces, clock, turn: visible.turn.clone() };
        while let Some(ids) =
            rounds.next(&mut test, &mut add_occluders).map_err(RoleError::of_culling::<D>)?
        {
            visible.push(ids).await?;
        }
        let stats = rounds.stats();
        self.stats.culling = stats.counts;
        self.stats.rounds = RoundCounts {
            further: rounds.rounds().saturating_sub(1),
            occluder_triangles: triangles(&scene, rounds.occluders()),
            drawing_ns: nanoseconds(drawing),
            tested: stats.tested_again,
            hidden: stats.hidden_later,
        };
        self.stats.occluders += count(rounds.occluders());
        self.stats.occluder_triangles += self.stats.rounds.occluder_triangles;
        self.take_times()
    }

    async fn find_in_frustum(
        &mut self,
        camera: Camera,
        visible: &mut VisibleIds<'_>,
    ) -> Result<(), RoleError> {
        self.view = View::of(camera, &self.state).on_grid(self.device.grid());
        let start = nanoseconds(self.clock.elapsed());
        self.stats = FrameStats {
            frame: camera.frame(),
            or_start_ns: start,
            or_end_ns: start,
            ..FrameStats::default()
        };
        let scene = self.culler.scene();
        let found = scene.reading(|| lod_cut(scene, &self.view, &self.rule));
        let found = found.map_err(|fault| RoleError::of_culling::<D>(CullError::Scene(fault)))?;
        self.stats.culling.emitted = count(&found);
        visible.push(&found).await
    }

    /// A set that stops at few pixels depends on what is hidden, so it has no other form.
    fn counted_cost(&self, ids: &[DrawableId]) -> Option<Duration> {
        let (costs, size) = (Costs::of(self.device.class()), self.view.viewport());
        let exact = !self.rule.lod().stops_at_few_pixels();
        exact.then(|| costs.of_frame(&self.stats, size, ids.len(), triangles(self.culler.scene(), ids)))
    }

    fn frame_stats(&mut self) -> FrameStats {
        self.stats.hc_end_ns = nanoseconds(self.clock.elapsed());
        self.stats.hc_start_ns = self.stats.or_end_ns;
        self.stats
    }
}

fn count(ids: &[DrawableId]) -> u32 {
    u32::try_from(ids.len()).unwrap_or(u32::MAX)
}
