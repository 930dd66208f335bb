//! Walks a trial on a Vulkan device.

use std::{fmt, sync::Arc};

use serde::{Deserialize, Serialize};
use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_audit::search::{Trial, TrialError};
use trimaran_cull::Image;
use trimaran_gpu::{Gpu, GpuError, GpuScene, ItemImage};
use trimaran_proto::{Camera, DrawableId, LodRule, OcclusionTestKind, Settings, ViewState};
use trimaran_scene::Scene;

use super::{
    device::{CaseWalkError, Played, Way, changes},
    figures::{Figures, outside},
};
use crate::{
    comparison::System,
    walkthrough::{AuditError, Auditor, FrameRecord, Judgement, ViewStates},
};

/// How a trial is culled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrialCulling {
    /// The roles, and how they cull.
    pub system: System,
    /// The occlusion test of Trimaran's own method.
    pub occlusion_test: OcclusionTestKind,
}

impl TrialCulling {
    /// All of them: each system with each occlusion test that it can have.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let any = LodRule::new(1.0).ok();
        let ways = any.into_iter().flat_map(Way::all).filter(|way| way.system != System::Frustum);
        ways.map(|way| Self { system: way.system, occlusion_test: way.occlusion_test }).collect()
    }
}

/// Why a trial was not walked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrialWalkError {
    /// The trial is malformed.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// The walk failed.
    #[error(transparent)]
    Walk(#[from] CaseWalkError),
}

impl From<GpuError> for TrialWalkError {
    fn from(error: GpuError) -> Self {
        Self::Walk(error.into())
    }
}

impl From<AuditError> for TrialWalkError {
    fn from(error: AuditError) -> Self {
        Self::Walk(error.into())
    }
}

/// A frame without culling.
struct Truth {
    cut: Vec<DrawableId>,
    items: ItemImage,
    /// If something is see-through, which an ID buffer does not show.
    picture: Option<Image>,
}

/// A trial on a device. The pictures without culling are drawn once.
pub struct TrialOnDevice {
    scene: Arc<Scene>,
    drawn: Arc<GpuScene>,
    states: Vec<ViewState>,
    cameras: Vec<Camera>,
    views: ViewStates,
    auditor: Auditor,
    truth: Vec<Truth>,
    runtime: Handle,
}

impl TrialOnDevice {
    /// Copies a trial's scene to a device, and draws its frames without culling.
    ///
    /// # Errors
    /// If the trial is malformed, or the device fails.
    pub fn new(trial: &Trial, gpu: &Arc<Gpu>, runtime: &Handle) -> Result<Self, TrialWalkError> {
        let scene = trial.scene()?;
        let states = trial.frames.iter().map(|frame| frame.view_state(OcclusionTestKind::Hzb));
        let states = states.collect::<Result<Vec<_>, _>>()?;
        let settings = settings(&states, OcclusionTestKind::Hzb).ok_or(CaseWalkError::NoView)?;
        let views = changes(settings, states.iter().cloned());
        let cameras = (0..).zip(&trial.frames).map(|(number, frame)| {
            Ok(frame.camera(number).map_err(TrialError::from)?.in_view(views.version_at(number)))
        });
        let cameras = cameras.collect::<Result<Vec<_>, TrialWalkError>>()?;
        let drawn = GpuScene::new(gpu, &scene)?;
        let mut auditor = Auditor::new(&scene, &drawn, views.clone())?;
        let mut truth = Vec::with_capacity(cameras.len());
        for (camera, state) in cameras.iter().zip(&states) {
            let (cut, items) = auditor.unculled_items(*camera)?;
            let mut picture = state.see_through.is_some().then(Image::default);
            if let Some(picture) = &mut picture {
                auditor.unculled(*camera, picture)?;
            }
            truth.push(Truth { cut, items, picture });
        }
        Ok(Self { scene, drawn, states, cameras, views, auditor, truth, runtime: runtime.clone() })
    }

    /// Walks the trial, compares each frame with the one without culling, and holds wrong pixels against a
    /// rasterizer in f64.
    ///
    /// # Errors
    /// If the device fails, or a role.
    pub fn judged(&mut self, culling: TrialCulling) -> Result<(Figures, Judgement), TrialWalkError> {
        let (mut figures, mut judgement) = Default::default();
        for record in self.records(culling)? {
            self.compare(&record, &mut figures, &mut judgement)?;
        }
        Ok((figures, judgement))
    }

    fn records(&self, culling: TrialCulling) -> Result<Vec<FrameRecord>, CaseWalkError> {
        let test = culling.occlusion_test;
        let settings = settings(&self.states, test).ok_or(CaseWalkError::NoView)?;
        let states = self.states.iter().map(|state| ViewState { occlusion_test: test, ..state.clone() });
        let views = changes(settings, states);
        let Self { scene, drawn, cameras, runtime, .. } = self;
        Played { scene, drawn, views: &views, cameras }.by(culling.system, settings, runtime)
    }

    fn compare(
        &mut self,
        record: &FrameRecord,
        figures: &mut Figures,
        judgement: &mut Judgement,
    ) -> Result<(), TrialWalkError> {
        let number = record.camera.frame();
        let Some(truth) = self.truth.get(number.0 as usize) else { return Ok(()) };
        figures.drawn += record.ids.len() as u64;
        figures.whole += truth.cut.len() as u64;
        if record.ids == truth.cut {
            figures.add(number, 0, 0);
            return Ok(());
        }
        figures.outside_cut += outside(&record.ids, &truth.cut);
        let mut difference = self.auditor.triangle_difference(&truth.items, record)?;
        if let Some(picture) = &truth.picture {
            let mut shown = Image::default();
            self.auditor.picture(record, &mut shown).map_err(AuditError::from)?;
            let [shown, whole] = [&shown, picture].map(|picture| picture.rgba.chunks_exact(4));
            let wrong = shown.zip(whole).filter(|(shown, whole)| shown != whole).count() as u64;
            judgement.blended += wrong.saturating_sub(difference.pixels);
            difference.pixels = difference.pixels.max(wrong);
        }
        figures.add(number, difference.pixels, difference.lost_nodes);
        if difference.pixels > 0 {
            let shown = self.auditor.items(record)?;
            let view = self.views.view(record.camera).on_grid(self.drawn.gpu().info().sub_pixel_grid);
            let rule = self.views.rule(&self.scene, &record.camera);
            judgement.add(&self.scene, &view, &rule, &truth.cut, [&truth.items, &shown]);
        }
        Ok(())
    }
}

impl fmt::Display for TrialCulling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.system, self.occlusion_test)
    }
}

/// The settings of a session that begins with the first of these.
fn settings(states: &[ViewState], occlusion_test: OcclusionTestKind) -> Option<Settings> {
    let first = states.first()?;
    Some(Settings { occlusion_test, ..Settings::new(first.viewport, first.lod) })
}
