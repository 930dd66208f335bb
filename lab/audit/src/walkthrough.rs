//! The whole loop on the CPU: OR (draw occluders), HC (cull) and RVG (show) in turn, frame by frame, beside
//! the exact reference.
//!
//! Exact culling rests on five conditions. [`Fault`] breaks each on purpose, to test that a check of the
//! pictures notices.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use thiserror::Error;
use trimaran_cull::{
    CullError, CullStats, Culler, CutRule, DepthImage, DepthPyramid, DrawOrder, FalseCullCause, HzbError,
    HzbTest, LodCut, OccluderError, OccluderMapper, View,
};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::attribution::{CulledFrame, Missing, causes};
use crate::fault::{AnyTest, Fault, Tampered};
use crate::id_buffer::{IdBuffer, Placement, rasterize};
use crate::occlusion_test::ReferenceTest;

/// Which occlusion test HC uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Testing {
    /// Boxes rasterized in f64: [`ReferenceTest`].
    #[default]
    Rasterized,
    /// The depth pyramid: [`HzbTest`].
    Pyramid,
}

/// The result of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameReport {
    /// Counters of HC's traversal.
    pub stats: CullStats,
    /// The occluders that OR drew.
    pub occluders: Vec<DrawableId>,
    /// The drawables that HC emitted, in drawing order.
    pub emitted: Vec<DrawableId>,
    /// The drawables visible without culling.
    pub exact: Vec<DrawableId>,
    /// The drawables visible without culling and not drawn: must be none.
    pub false_culled: Vec<FalseCull>,
    /// Pixels that show another triangle than without culling: must be 0.
    pub differing_pixels: usize,
    /// The picture of RVG.
    pub shown: IdBuffer,
}

/// A drawable that is visible without culling and was not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FalseCull {
    /// Its id.
    pub id: DrawableId,
    /// The pixels it owns without culling.
    pub pixels: usize,
    /// The cause.
    pub cause: FalseCullCause,
}

/// Why a reference walkthrough stopped.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WalkthroughError {
    /// Culling failed.
    #[error("culling failed")]
    Culling(#[from] CullError<HzbError>),
    /// The pyramid does not fit the depth.
    #[error("the depth pyramid does not fit the depth")]
    Size(#[from] HzbError),
    /// The last frame's ids are not of this scene.
    #[error("the last frame's ids are not of this scene")]
    Ids(#[from] OccluderError),
}

/// OR, HC and RVG on one CPU, with their state between frames.
#[derive(Debug)]
pub struct ReferenceWalkthrough {
    culler: Culler,
    rule: CutRule,
    testing: Testing,
    placement: Placement,
    fault: Fault,
    last: Option<Last>,
}

/// The state from the previous frame.
#[derive(Debug)]
struct Last {
    view: View,
    emitted: Vec<DrawableId>,
    drawn: Vec<DrawableId>,
    shown: IdBuffer,
}

/// OR's drawables, and their depth for every occlusion test.
#[derive(Debug)]
struct Occluders {
    ids: Vec<DrawableId>,
    buffer: IdBuffer,
    depth: Vec<f32>,
    pyramid: DepthPyramid,
}

impl Occluders {
    fn image(&self) -> Result<DepthImage<'_>, HzbError> {
        let size = self.buffer.viewport();
        DepthImage::new(size, &self.depth).map_err(|_| HzbError::Size { image: size, other: Some(size) })
    }
}

impl ReferenceWalkthrough {
    /// A walkthrough of `scene`, before its first frame.
    #[must_use]
    pub fn new(scene: Arc<Scene>, rule: impl Into<CutRule>) -> Self {
        Self {
            culler: Culler::new(scene),
            rule: rule.into(),
            testing: Testing::default(),
            placement: Placement::default(),
            fault: Fault::None,
            last: None,
        }
    }

    /// The same walkthrough with another occlusion test.
    #[must_use]
    pub fn testing(self, testing: Testing) -> Self {
        Self { testing, ..self }
    }

    /// The same walkthrough with vertices placed otherwise.
    #[must_use]
    pub fn placing(self, placement: Placement) -> Self {
        Self { placement, ..self }
    }

    /// The same walkthrough with a fault.
    #[must_use]
    pub fn with_fault(self, fault: Fault) -> Self {
        Self { fault, ..self }
    }

    /// Uses another rule for the LOD cut from the next frame on.
    pub fn set_rule(&mut self, rule: impl Into<CutRule>) {
        self.rule = rule.into();
    }

    /// One frame.
    ///
    /// # Errors
    /// Those of the parts of the loop; none is expected.
    pub fn frame(&mut self, view: &View) -> Result<FrameReport, WalkthroughError> {
        let scene = Arc::clone(self.culler.scene());
        let mut order = DrawOrder::default();
        let occluders = self.draw_occluders(&scene, view)?;
        let mut emitted = Vec::new();
        let mut test = self.occlusion_test(&occluders)?;
        let stats = self.culler.cull(view, &self.rule, &mut test, |ids| emitted.extend_from_slice(ids))?;
        order.sort(&scene, view, &mut emitted);
        let drawn = self.fault.arrived(&scene, &emitted);
        let shown = rasterize(&scene, view, drawn.iter().copied(), self.placement);
        let mut cut = LodCut::new(&scene, view, &self.rule).drawables();
        order.sort(&scene, view, &mut cut);
        let truth = rasterize(&scene, view, cut, self.placement);
        let exact = truth.seen();

        let missing = missing(&truth, &drawn);
        let before: Vec<(View, &[DrawableId])> =
            self.last.iter().map(|last| (last.view, last.drawn.as_slice())).collect();
        let frame = CulledFrame {
            scene: &scene,
            view,
            rule: &self.rule,
            occluders: &occluders.ids,
            depth: &occluders.depth,
            sent: Some(emitted.len() as u64),
            drawn: &drawn,
            bias_px: 0.0,
            before: &before,
        };
        let causes = causes(&frame, &mut test, &missing)?;
        let false_cull =
            |(lost, cause): (&Missing, _)| FalseCull { id: lost.id, pixels: lost.pixels.len(), cause };
        let false_culled = missing.iter().zip(causes).map(false_cull).collect();

        let differing_pixels = shown.differing_pixels(&truth);
        self.last = Some(Last { view: *view, emitted: emitted.clone(), drawn, shown: shown.clone() });
        let occluders = occluders.ids;
        Ok(FrameReport { stats, occluders, emitted, exact, false_culled, differing_pixels, shown })
    }

    /// OR: the last frame's ids, mapped to this view's cut and drawn from it; nothing in the first frame.
    fn draw_occluders(&self, scene: &Arc<Scene>, view: &View) -> Result<Occluders, WalkthroughError> {
        let mut ids = Vec::new();
        match &self.last {
            Some(last) if self.fault == Fault::OtherLevels => ids.extend_from_slice(&last.emitted),
            Some(last) => {
                OccluderMapper::new(Arc::clone(scene), *view, &self.rule).push(&last.emitted, &mut ids)?;
                self.rule.retain_solid(scene, &mut ids);
            }
            None => {}
        }
        let mut buffer = match &self.last {
            Some(last) if self.fault == Fault::StaleDepth && last.view.viewport() == view.viewport() => {
                last.shown.clone()
            }
            _ => rasterize(scene, view, ids.iter().copied(), self.placement),
        };
        if let Fault::NearerOccluders(fraction) = self.fault {
            buffer.bring_nearer(fraction);
        }
        let depth = buffer.depth32();
        let mut occluders = Occluders { ids, buffer, depth, pyramid: DepthPyramid::default() };
        if self.testing == Testing::Pyramid {
            occluders.pyramid = DepthPyramid::over(occluders.image()?);
        }
        Ok(occluders)
    }

    /// HC's occlusion test.
    fn occlusion_test<'o>(&self, occluders: &'o Occluders) -> Result<Tampered<'o>, HzbError> {
        let inner = match self.testing {
            Testing::Rasterized => AnyTest::Rasterized(ReferenceTest::new(&occluders.buffer)),
            Testing::Pyramid => AnyTest::Pyramid(HzbTest::new(occluders.image()?, &occluders.pyramid)?),
        };
        Ok(Tampered { inner, fault: self.fault })
    }
}

/// The drawables that own pixels without culling and were not drawn.
fn missing(truth: &IdBuffer, drawn: &[DrawableId]) -> Vec<Missing> {
    let drawn: BTreeSet<DrawableId> = drawn.iter().copied().collect();
    let mut missing = BTreeMap::<DrawableId, Vec<usize>>::new();
    for (pixel, id) in truth.ids().iter().enumerate() {
        if let Some(id) = id.filter(|id| !drawn.contains(&id.drawable)) {
            missing.entry(id.drawable).or_default().push(pixel);
        }
    }
    missing.into_iter().map(|(id, pixels)| Missing { id, pixels }).collect()
}
