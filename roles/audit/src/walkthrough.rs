//! The whole loop on the CPU: OR, HC and RVG as one machine, frame by frame, beside the truth.
//!
//! Why culling is exact rests on five conditions. [`Fault`] breaks each on purpose, to see that a check of
//! the pictures notices.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use thiserror::Error;
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::attribution::{CulledFrame, Missing, causes};
use crate::cause::FalseCullCause;
use crate::fault::{AnyTester, Fault, Tampered};
use crate::id_buffer::{Picture, Placement, rasterize};
use crate::occlusion_test::ReferenceTester;
use trimaran_cull::{
    CullError, CullStats, Culler, CutRule, DepthImage, DepthPyramid, DrawOrder, HzbError, HzbTester,
    LevelCut, OccluderError, OccluderMapper, View,
};

/// Which tester HC uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Testing {
    /// Boxes rasterized by the oracle.
    #[default]
    Rasterized,
    /// The depth pyramid.
    Pyramid,
}

/// What one frame came to.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameReport {
    /// HC's figures.
    pub stats: CullStats,
    /// What OR drew.
    pub occluders: Vec<DrawableId>,
    /// What HC emitted, in drawing order.
    pub emitted: Vec<DrawableId>,
    /// What is seen in the unculled picture.
    pub exact: Vec<DrawableId>,
    /// What is seen in the unculled picture and was not drawn: must be none.
    pub false_culled: Vec<FalseCull>,
    /// Pixels at which the culled picture shows another item than the unculled one: must be 0.
    pub differing_pixels: usize,
    /// The culled picture.
    pub picture: Picture,
}

/// A drawable that is seen in the unculled picture and was not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FalseCull {
    /// Which.
    pub id: DrawableId,
    /// The pixels it owns in the unculled picture.
    pub pixels: usize,
    /// Why it was not drawn.
    pub cause: FalseCullCause,
}

/// Why a reference walk stopped.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WalkError {
    /// Culling failed.
    #[error("culling failed")]
    Culling(#[from] CullError<HzbError>),
    /// The pyramid does not fit the picture.
    #[error("the depth pyramid does not fit the picture")]
    Size(#[from] HzbError),
    /// The last frame's ids are not of this scene.
    #[error("the last frame's ids are not of this scene")]
    Ids(#[from] OccluderError),
}

/// The three machines.
#[derive(Debug)]
pub struct ReferenceWalk {
    culler: Culler,
    rule: CutRule,
    testing: Testing,
    placement: Placement,
    fault: Fault,
    last: Option<Last>,
}

/// What is left of the frame before.
#[derive(Debug)]
struct Last {
    view: View,
    emitted: Vec<DrawableId>,
    drawn: Vec<DrawableId>,
    picture: Picture,
}

/// What OR drew, and its depth as every tester wants it.
#[derive(Debug)]
struct Occluders {
    ids: Vec<DrawableId>,
    picture: Picture,
    depth: Vec<f32>,
    pyramid: DepthPyramid,
}

impl Occluders {
    fn image(&self) -> Result<DepthImage<'_>, HzbError> {
        let size = self.picture.viewport();
        DepthImage::new(size, &self.depth).map_err(|_| HzbError::Size { image: size, other: Some(size) })
    }
}

impl ReferenceWalk {
    /// A walk through `scene`, before its first frame.
    #[must_use]
    pub fn new(scene: Arc<Scene>, rule: CutRule) -> Self {
        Self {
            culler: Culler::new(scene),
            rule,
            testing: Testing::default(),
            placement: Placement::default(),
            fault: Fault::None,
            last: None,
        }
    }

    /// The same walk with another tester.
    #[must_use]
    pub fn testing(self, testing: Testing) -> Self {
        Self { testing, ..self }
    }

    /// The same walk with vertices placed otherwise.
    #[must_use]
    pub fn placing(self, placement: Placement) -> Self {
        Self { placement, ..self }
    }

    /// The same walk with a fault.
    #[must_use]
    pub fn with_fault(self, fault: Fault) -> Self {
        Self { fault, ..self }
    }

    /// One frame.
    ///
    /// # Errors
    /// As the parts of the loop say; none is expected.
    pub fn frame(&mut self, view: &View) -> Result<FrameReport, WalkError> {
        let scene = Arc::clone(self.culler.scene());
        let mut order = DrawOrder::default();
        let occluders = self.draw_occluders(&scene, view)?;
        let mut emitted = Vec::new();
        let mut tester = self.tester(&occluders)?;
        let stats = self.culler.cull(view, self.rule, &mut tester, |ids| emitted.extend_from_slice(ids))?;
        order.sort(&scene, view, &mut emitted);
        let drawn = self.fault.arrived(&scene, &emitted);
        let picture = rasterize(&scene, view, drawn.iter().copied(), self.placement);
        let mut cut = LevelCut::new(&scene, view, self.rule).drawables();
        order.sort(&scene, view, &mut cut);
        let truth = rasterize(&scene, view, cut, self.placement);
        let exact = truth.seen();

        let missing = missing(&truth, &drawn);
        let before: Vec<(View, &[DrawableId])> =
            self.last.iter().map(|last| (last.view, last.drawn.as_slice())).collect();
        let frame = CulledFrame {
            scene: &scene,
            view,
            rule: self.rule,
            occluders: &occluders.ids,
            depth: &occluders.depth,
            sent: Some(emitted.len() as u64),
            drawn: &drawn,
            before: &before,
        };
        let causes = causes(&frame, &mut tester, &missing)?;
        let false_cull =
            |(lost, cause): (&Missing, _)| FalseCull { id: lost.id, pixels: lost.pixels.len(), cause };
        let false_culled = missing.iter().zip(causes).map(false_cull).collect();

        let differing_pixels = picture.differing_pixels(&truth);
        self.last = Some(Last { view: *view, emitted: emitted.clone(), drawn, picture: picture.clone() });
        let occluders = occluders.ids;
        Ok(FrameReport { stats, occluders, emitted, exact, false_culled, differing_pixels, picture })
    }

    /// OR: the last frame's ids, mapped to this view's cut and drawn from it; nothing before there is a last
    /// frame.
    fn draw_occluders(&self, scene: &Arc<Scene>, view: &View) -> Result<Occluders, WalkError> {
        let mut ids = Vec::new();
        match &self.last {
            Some(last) if self.fault == Fault::OtherLevels => ids.extend_from_slice(&last.emitted),
            Some(last) => {
                OccluderMapper::new(Arc::clone(scene), *view, self.rule).push(&last.emitted, &mut ids)?;
            }
            None => {}
        }
        let mut picture = match &self.last {
            Some(last) if self.fault == Fault::StaleDepth && last.view.viewport() == view.viewport() => {
                last.picture.clone()
            }
            _ => rasterize(scene, view, ids.iter().copied(), self.placement),
        };
        if let Fault::NearerOccluders(fraction) = self.fault {
            picture.bring_nearer(fraction);
        }
        let depth = picture.depth32();
        let occluders = Occluders { ids, picture, depth, pyramid: DepthPyramid::new() };
        let mut pyramid = DepthPyramid::new();
        if self.testing == Testing::Pyramid {
            pyramid.rebuild(occluders.image()?);
        }
        Ok(Occluders { pyramid, ..occluders })
    }

    /// HC's tester.
    fn tester<'o>(&self, occluders: &'o Occluders) -> Result<Tampered<'o>, HzbError> {
        let inner = match self.testing {
            Testing::Rasterized => AnyTester::Rasterized(ReferenceTester::new(&occluders.picture)),
            Testing::Pyramid => AnyTester::Pyramid(HzbTester::new(occluders.image()?, &occluders.pyramid)?),
        };
        Ok(Tampered { inner, fault: self.fault })
    }
}

/// What owns pixels of the unculled picture and was not drawn.
fn missing(truth: &Picture, drawn: &[DrawableId]) -> Vec<Missing> {
    let drawn: BTreeSet<DrawableId> = drawn.iter().copied().collect();
    let mut missing = BTreeMap::<DrawableId, Vec<usize>>::new();
    for (pixel, item) in truth.items().iter().enumerate() {
        if let Some(item) = item.filter(|item| !drawn.contains(&item.drawable)) {
            missing.entry(item.drawable).or_default().push(pixel);
        }
    }
    missing.into_iter().map(|(id, pixels)| Missing { id, pixels }).collect()
}
