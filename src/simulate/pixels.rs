//! The effect of lost ids on the pictures: frames that came with gaps are drawn as the display draws them,
//! and without loss.

use std::sync::Arc;

use thiserror::Error;
use trimaran_actors::Gaps;
use trimaran_audit::metrics::{ImageRef, MetricError, mismatching_pixels};
use trimaran_cull::{Image, LodRule, LodRuleError, OccluderError, View, Viewport, draw_order};
use trimaran_gpu::{GpuError, GpuScene, PicturePass};
use trimaran_proto::{DrawableId, FrameNumber, SettingsError};
use trimaran_scene::Scene;

use super::outcome::Outcome;
use super::statistics::PixelCost;
use super::workload::Workload;
use crate::trace::{OtherScene, Trace};

/// Why the effect cannot be measured.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PixelError {
    /// The trace has no ids.
    #[error("only a trace of `trimaran run --record` says which ids each frame has")]
    NoIds,
    /// The trace is of another scene.
    #[error(transparent)]
    OtherScene(#[from] OtherScene),
    /// The device fails.
    #[error("drawing the frames with gaps failed")]
    Gpu(#[from] GpuError),
    /// The picture's size is out of range.
    #[error(transparent)]
    Viewport(#[from] SettingsError),
    /// The error bound is invalid.
    #[error(transparent)]
    Rule(#[from] LodRuleError),
    /// An id does not belong to the scene.
    #[error(transparent)]
    Ids(#[from] OccluderError),
    /// The pictures differ in size.
    #[error(transparent)]
    Metric(#[from] MetricError),
}

/// Draws frames of a recorded walk as shown by a display that got only a part of their ids.
pub struct Painter {
    scene: Arc<Scene>,
    viewport: Viewport,
    rule: LodRule,
    pass: PicturePass,
    shown: Image,
    whole: Image,
}

impl Painter {
    /// For walks through `drawn`, recorded as `trace` says.
    ///
    /// # Errors
    /// When the trace is of another scene, or the device cannot draw its pictures.
    pub fn new(scene: &Arc<Scene>, drawn: &Arc<GpuScene>, trace: &Trace) -> Result<Self, PixelError> {
        trace.check_scene(scene.hash())?;
        let [width, height] = trace.size;
        let viewport = Viewport::new(width, height)?;
        Ok(Self {
            scene: Arc::clone(scene),
            viewport,
            rule: LodRule::new(trace.epsilon_px)?.stopping_at_few_pixels(trace.few_pixels),
            pass: PicturePass::new(drawn, viewport)?,
            shown: Image::default(),
            whole: Image::default(),
        })
    }

    /// Measures the effect of the gaps of a session with this `workload`.
    ///
    /// HC is assumed to find the recorded ids, although occluders that lack some ids hide less, never more.
    ///
    /// # Errors
    /// When the device fails.
    pub fn cost(&mut self, workload: &Workload, outcome: &Outcome) -> Result<PixelCost, PixelError> {
        if workload.trace().is_none() {
            return Err(PixelError::NoIds);
        }
        let mut cost = PixelCost { frames: outcome.frames, ..PixelCost::default() };
        let mut gaps = Gaps::new(&self.scene);
        let mut drawn_before: Option<(u32, Vec<DrawableId>)> = None;
        for (&frame, came) in &outcome.remains {
            let view = View::new(workload.camera(FrameNumber(frame)), self.viewport);
            match (&drawn_before, frame.checked_sub(1)) {
                (Some((before, ids)), Some(last)) if *before == last => gaps.drawn(ids),
                (_, Some(last)) => gaps.drawn(&workload.ids(last)),
                (_, None) => gaps.drawn(&[]),
            }
            let mut ids = came.clone();
            gaps.fill(view, &self.rule.into(), &mut ids)?;
            ids.sort_unstable();
            let whole = workload.ids(frame);
            if ids == *whole {
                // The last frame had all missing ids: no pixel differs.
                drawn_before = Some((frame, ids));
                continue;
            }
            let needless = ids.iter().filter(|id| whole.binary_search(id).is_err());
            cost.needless_triangles += needless.map(|id| self.triangles(*id)).sum::<u64>();
            Self::draw(&mut self.pass, &self.scene, &view, ids.clone(), &mut self.shown)?;
            Self::draw(&mut self.pass, &self.scene, &view, whole.into_owned(), &mut self.whole)?;
            let wrong = mismatching_pixels(&ImageRef::of(&self.shown)?, &ImageRef::of(&self.whole)?)?;
            cost.frames_wrong += u32::from(wrong > 0);
            cost.wrong_pixels += wrong;
            cost.worst = cost.worst.max(wrong);
            drawn_before = Some((frame, ids));
        }
        Ok(cost)
    }

    fn triangles(&self, id: DrawableId) -> u64 {
        self.scene.drawables().get(id.index()).map_or(0, |drawable| u64::from(drawable.triangles))
    }

    fn draw(
        pass: &mut PicturePass,
        scene: &Scene,
        view: &View,
        mut ids: Vec<DrawableId>,
        into: &mut Image,
    ) -> Result<(), GpuError> {
        draw_order(scene, view, &mut ids);
        pass.begin(view)?;
        pass.draw(&ids)?;
        pass.finish()?;
        pass.read(into)
    }
}

impl PixelCost {
    /// Wrong pixels a frame, over all frames.
    #[must_use]
    pub fn wrong_a_frame(&self) -> f64 {
        self.wrong_pixels as f64 / f64::from(self.frames.max(1))
    }

    /// Needless triangles a frame, over all frames.
    #[must_use]
    pub fn needless_a_frame(&self) -> f64 {
        self.needless_triangles as f64 / f64::from(self.frames.max(1))
    }
}
