//! Walks a trial on a Vulkan device.

use std::{fmt, ops::AddAssign, sync::Arc};

use serde::{Deserialize, Serialize};
use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_audit::{
    Placement, rasterize,
    search::{Trial, TrialError},
};
use trimaran_cull::{CutRule, Image, View};
use trimaran_gpu::{Gpu, GpuError, GpuScene, ItemImage};
use trimaran_proto::{Camera, DrawableId, LodRule, OcclusionTestKind, Settings, ViewState};
use trimaran_scene::Scene;

use super::{
    device::{CaseWalkError, Played, Way, changes},
    figures::{Figures, outside},
};
use crate::{
    comparison::System,
    walkthrough::{AuditError, Auditor, FrameRecord, ViewStates},
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

/// Pixels that culling changed, by what a rasterizer in f64 shows there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Judgement {
    /// It shows what is there with culling: the driver has drawn something in front of what hides it.
    pub driver: u64,
    /// It shows what is there without culling: the culler has lost something.
    pub culler: u64,
    /// It shows something else: surfaces of one depth, or an edge.
    pub neither: u64,
    /// The same solid triangle shows, and what is see-through before it differs. The rasterizer does not
    /// blend.
    pub blended: u64,
}

impl AddAssign for Judgement {
    fn add_assign(&mut self, other: Self) {
        self.driver += other.driver;
        self.culler += other.culler;
        self.neither += other.neither;
        self.blended += other.blended;
    }
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
            let (view, rule) = (self.views.view(record.camera), self.views.rule(&self.scene, &record.camera));
            judgement.add(&self.scene, &view, &rule, truth, &shown);
        }
        Ok(())
    }
}

impl fmt::Display for TrialCulling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.system, self.occlusion_test)
    }
}

impl fmt::Display for Judgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { driver, culler, neither, blended } = self;
        write!(f, "in f64, {driver} are right with culling, {culler} without, {neither} are neither")?;
        if *blended > 0 {
            write!(f, "; {blended} differ only in what is see-through")?;
        }
        Ok(())
    }
}

impl Judgement {
    /// Whether wrong pixels are right with culling, and none is without.
    #[must_use]
    pub const fn is_of_driver(&self) -> bool {
        self.driver > 0 && self.culler + self.blended == 0
    }

    fn add(&mut self, scene: &Scene, view: &View, rule: &CutRule, truth: &Truth, shown: &ItemImage) {
        let pairs = |items: &ItemImage| -> Vec<[u32; 2]> {
            items
                .drawable
                .iter()
                .zip(&items.triangle)
                .map(|(drawable, triangle)| [*drawable, *triangle])
                .collect()
        };
        let (whole, shown) = (pairs(&truth.items), pairs(shown));
        if whole == shown {
            return;
        }
        let solid = rule.divide(scene, &truth.cut, &mut Vec::new());
        let right = rasterize(scene, view, solid.iter().copied(), Placement::Exact);
        let right = right
            .ids()
            .iter()
            .map(|id| id.map_or([ItemImage::BACKGROUND; 2], |id| [id.drawable.0, id.triangle]));
        for ((whole, shown), right) in whole.into_iter().zip(shown).zip(right).filter(|((a, b), _)| a != b) {
            let count = match right {
                _ if right == shown => &mut self.driver,
                _ if right == whole => &mut self.culler,
                _ => &mut self.neither,
            };
            *count += 1;
        }
    }
}

/// The settings of a session that begins with the first of these.
fn settings(states: &[ViewState], occlusion_test: OcclusionTestKind) -> Option<Settings> {
    let first = states.first()?;
    Some(Settings { occlusion_test, ..Settings::new(first.viewport, first.lod) })
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
    use trimaran_audit::cases::{Mesh, Object, build, looking};
    use trimaran_cull::{Viewport, lod_cut};

    use super::*;

    #[test]
    fn the_rasterizer_says_which_picture_is_wrong() {
        let wall = Object::new(Mesh::rectangle(Vec3::Y * 2.0, Vec3::X * 9.0, Vec3::Z * 9.0, 1));
        let scene = build(&[wall], false).unwrap();
        let view = looking(DVec3::ZERO, DVec3::Y, 90.0, Viewport::new(8, 8).unwrap(), 0).unwrap();
        let rule = CutRule::from(LodRule::new(1.0).unwrap());
        let cut = lod_cut(&scene, &view, &rule);
        let right = rasterize(&scene, &view, cut.iter().copied(), Placement::Exact);
        let items = |at: usize, drawable: u32| {
            let mut items = ItemImage { width: 8, height: 8, ..ItemImage::default() };
            items.drawable = right.ids().iter().map(|id| id.unwrap().drawable.0).collect();
            items.triangle = right.ids().iter().map(|id| id.unwrap().triangle).collect();
            items.drawable[at] = drawable;
            items
        };
        let judged = |whole: ItemImage, shown: ItemImage| {
            let truth = Truth { cut: cut.clone(), items: whole, picture: None };
            let mut judgement = Judgement::default();
            judgement.add(&scene, &view, &rule, &truth, &shown);
            judgement
        };
        let (sound, none) = (cut[0].0, Judgement::default());
        assert_eq!(judged(items(5, sound), items(5, sound)), none);
        assert_eq!(judged(items(5, sound), items(5, 7)), Judgement { culler: 1, ..none });
        assert_eq!(judged(items(5, 7), items(5, sound)), Judgement { driver: 1, ..none });
        assert_eq!(judged(items(5, 7), items(5, 8)), Judgement { neither: 1, ..none });
        assert_eq!(judged(items(5, 7), items(6, 7)), Judgement { driver: 1, culler: 1, ..none });
    }
}
