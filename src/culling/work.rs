//! A culler's work by any method.

use std::{borrow::Cow, sync::Arc, time::Duration};

use trimaran_actors::{CullerWork, RoleError, SceneCulling, Stop, Stopwatch, Turns, VisibleIds};
use trimaran_cull::{CutRule, SubPixelGrid, View, triangles};
use trimaran_gpu::VulkanCuller;
use trimaran_proto::{
    Camera, CullCounts, DrawableId, FrameNumber, FrameStats, OcclusionTestKind, Settings, ViewState,
};
use trimaran_scene::Scene;

/// A culler's work by one of the [methods](super::CullingMethod).
pub struct Culling {
    work: Work,
    /// Ends waits for the device, instead of the session's own stop.
    cancel: Option<Stop>,
    /// The occlusion test of every view state, instead of its own.
    test: Option<OcclusionTestKind>,
}

/// All sessions but comparisons use the first one.
enum Work {
    Scene(Box<SceneCulling<VulkanCuller>>),
    Whole(Box<WholeFrames>),
}

impl From<SceneCulling<VulkanCuller>> for Culling {
    fn from(culling: SceneCulling<VulkanCuller>) -> Self {
        Self { work: Work::Scene(Box::new(culling)), cancel: None, test: None }
    }
}

impl From<WholeFrames> for Culling {
    fn from(culling: WholeFrames) -> Self {
        Self { work: Work::Whole(Box::new(culling)), cancel: None, test: None }
    }
}

impl Culling {
    /// Waits for the device end early once `stop` is requested, but not when only the session is to end.
    #[must_use]
    pub fn cancelled_by(self, stop: &Stop) -> Self {
        Self { cancel: Some(stop.clone()), ..self }
    }

    /// The same with this occlusion test under every view state.
    #[cfg(feature = "lab")]
    pub(super) fn by(self, test: OcclusionTestKind) -> Self {
        Self { test: Some(test), ..self }
    }
}

impl CullerWork for Culling {
    fn cancel_on(&mut self, stop: &Stop) {
        let stop = self.cancel.as_ref().unwrap_or(stop);
        match &mut self.work {
            Work::Scene(work) => work.cancel_on(stop),
            Work::Whole(work) => work.cancel_on(stop),
        }
    }

    fn change_view(&mut self, state: &ViewState) {
        let mut state = Cow::Borrowed(state);
        if let Some(test) = self.test {
            state.to_mut().occlusion_test = test;
        }
        let state = &*state;
        match &mut self.work {
            Work::Scene(work) => work.change_view(state),
            Work::Whole(work) => work.change_view(state),
        }
    }

    async fn begin_occluders(&mut self, camera: Camera, as_they_come: bool) -> Result<(), RoleError> {
        match &mut self.work {
            Work::Scene(work) => work.begin_occluders(camera, as_they_come).await,
            Work::Whole(work) => work.begin_occluders(camera, as_they_come).await,
        }
    }

    fn take_occluders(&mut self, ids: &[DrawableId]) -> Result<(), RoleError> {
        match &mut self.work {
            Work::Scene(work) => work.take_occluders(ids),
            Work::Whole(work) => work.take_occluders(ids),
        }
    }

    async fn complete_occluders(&mut self, camera: Camera) -> Result<(), RoleError> {
        match &mut self.work {
            Work::Scene(work) => work.complete_occluders(camera).await,
            Work::Whole(work) => work.complete_occluders(camera).await,
        }
    }

    async fn cull(&mut self, camera: Camera, visible: &mut VisibleIds<'_>) -> Result<(), RoleError> {
        match &mut self.work {
            Work::Scene(work) => work.cull(camera, visible).await,
            Work::Whole(work) => work.cull(camera, visible).await,
        }
    }

    async fn find_in_frustum(
        &mut self,
        camera: Camera,
        visible: &mut VisibleIds<'_>,
    ) -> Result<(), RoleError> {
        match &mut self.work {
            Work::Scene(work) => work.find_in_frustum(camera, visible).await,
            Work::Whole(work) => work.find_in_frustum(camera, visible).await,
        }
    }

    fn counted_cost(&self, ids: &[DrawableId]) -> Option<Duration> {
        match &self.work {
            Work::Scene(work) => work.counted_cost(ids),
            Work::Whole(work) => work.counted_cost(ids),
        }
    }

    fn frame_stats(&mut self) -> FrameStats {
        match &mut self.work {
            Work::Scene(work) => work.frame_stats(),
            Work::Whole(work) => work.frame_stats(),
        }
    }
}

/// The inputs for culling a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'f> {
    pub(super) view: &'f View,
    pub(super) rule: &'f CutRule,
}

/// A method that culls one frame after the other, each as a whole.
pub(super) trait FrameCuller {
    /// Once `stop` is requested, waits for a device end soon, with an error.
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// OR: draws occluders for this frame, given the drawables visible in the `last` one, and returns those
    /// drawn.
    fn draw_occluders(&mut self, seen: Seen<'_>, last: &[DrawableId]) -> Result<&[DrawableId], RoleError>;

    /// HC: adds the visible drawables to `found`.
    fn cull(&mut self, seen: Seen<'_>, found: &mut Vec<DrawableId>) -> Result<CullCounts, RoleError>;
}

/// A culler's work by a method that culls frames as a whole.
pub(super) struct WholeFrames {
    scene: Arc<Scene>,
    culler: Box<dyn FrameCuller>,
    state: ViewState,
    rule: CutRule,
    clock: Stopwatch,
    /// Of the current frame.
    view: View,
    /// The drawables visible in the frame before.
    last: Vec<DrawableId>,
    found: Vec<DrawableId>,
    stats: FrameStats,
}

impl WholeFrames {
    pub(super) fn new(
        scene: &Arc<Scene>,
        culler: Box<dyn FrameCuller>,
        grid: SubPixelGrid,
        settings: &Settings,
        turns: &Turns,
    ) -> Self {
        Self {
            scene: Arc::clone(scene),
            culler,
            state: (*settings).into(),
            rule: CutRule::new(scene, &(*settings).into()),
            clock: turns.clock(),
            view: View::new(Camera::at_origin(FrameNumber(0)), settings.viewport).on_grid(grid),
            last: Vec::new(),
            found: Vec::new(),
            stats: FrameStats::default(),
        }
    }
}

impl CullerWork for WholeFrames {
    fn cancel_on(&mut self, stop: &Stop) {
        self.culler.cancel_on(stop);
    }

    fn change_view(&mut self, state: &ViewState) {
        self.rule = CutRule::new(&self.scene, state);
        self.state = state.clone();
    }

    async fn begin_occluders(&mut self, camera: Camera, _as_they_come: bool) -> Result<(), RoleError> {
        self.view = View::of(camera, &self.state).on_grid(self.view.grid());
        self.last.clear();
        self.stats = FrameStats { frame: camera.frame(), ..FrameStats::default() };
        Ok(())
    }

    fn take_occluders(&mut self, ids: &[DrawableId]) -> Result<(), RoleError> {
        self.last.extend_from_slice(ids);
        Ok(())
    }

    async fn complete_occluders(&mut self, _: Camera) -> Result<(), RoleError> {
        let start = self.clock.elapsed();
        let seen = Seen { view: &self.view, rule: &self.rule };
        let drawn = self.culler.draw_occluders(seen, &self.last)?;
        self.stats.occluders = u32::try_from(drawn.len()).unwrap_or(u32::MAX);
        self.stats.occluder_triangles = triangles(&self.scene, drawn);
        self.stats.or_start_ns = nanoseconds(start);
        self.stats.or_end_ns = nanoseconds(self.clock.elapsed());
        self.stats.or_busy_ns = self.stats.or_end_ns - self.stats.or_start_ns;
        Ok(())
    }

    async fn cull(&mut self, _: Camera, visible: &mut VisibleIds<'_>) -> Result<(), RoleError> {
        self.found.clear();
        let seen = Seen { view: &self.view, rule: &self.rule };
        self.stats.culling = self.culler.cull(seen, &mut self.found)?;
        visible.push(&self.found).await
    }

    fn frame_stats(&mut self) -> FrameStats {
        self.stats.hc_end_ns = nanoseconds(self.clock.elapsed());
        self.stats.hc_start_ns = self.stats.or_end_ns;
        self.stats
    }
}

fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}
