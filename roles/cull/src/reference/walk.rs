//! The whole loop on the CPU: OR, HC and RVG as one machine, frame by frame, beside the truth.
//!
//! Why culling is exact rests on five conditions. [`Fault`] breaks each on purpose, to see that a check of the pictures notices.

use std::convert::Infallible;
use std::sync::Arc;

use thiserror::Error;
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use super::picture::{Picture, Placement, rasterize};
use super::tester::ReferenceTester;
use crate::{
    Answer, BoxTester, CullError, CullStats, Culler, CutRule, DepthImage, DepthPyramid, DrawOrder, HzbError,
    HzbTester, LevelCut, NoOccluders, OccluderError, OccluderMapper, Outline, TestBox, View,
};

/// One of the conditions of exact culling, broken.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Fault {
    /// None: all conditions hold.
    #[default]
    None,
    /// Condition 1: OR draws the levels it was sent and not those of its own cut.
    OtherLevels,
    /// As if OR had drawn from the camera before: its depth is the last frame's.
    StaleDepth,
    /// Condition 2: boxes are this much smaller than what they stand for.
    SmallBoxes(f32),
    /// Condition 3: boxes are not inflated against ties, but lie this fraction farther away.
    NoInflation(f32),
    /// Condition 3: boxes are not grown by half a pixel.
    NoOutline,
    /// Condition 4: every so manieth id never arrives at RVG.
    DroppedIds(usize),
    /// Condition 5: OR's vertices are this fraction nearer to the eye than RVG's.
    NearerOccluders(f64),
}

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
    /// What is seen in the unculled picture and was not emitted: must be none.
    pub false_culled: Vec<DrawableId>,
    /// Pixels at which the culled picture shows another item than the unculled one: must be 0.
    pub differing_pixels: usize,
    /// The culled picture.
    pub picture: Picture,
}

/// Why a reference walk stopped.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WalkError {
    /// The oracle's culling failed.
    #[error("culling with rasterized boxes failed")]
    Rasterized(#[from] CullError<Infallible>),
    /// Culling with the pyramid failed.
    #[error("culling with the depth pyramid failed")]
    Pyramid(#[from] CullError<HzbError>),
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
    last: Option<(Vec<DrawableId>, Picture)>,
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
        let (occluders, depth) = match &self.last {
            Some((ids, picture)) => {
                let (occluders, depth) = self.draw_occluders(&scene, view, ids, picture)?;
                (occluders, Some(depth))
            }
            None => (Vec::new(), None),
        };
        let (mut emitted, stats) = self.cull(view, depth.as_ref())?;
        order.sort(&scene, view, &mut emitted);
        let arrived = emitted.iter().enumerate().filter_map(|(index, &id)| match self.fault {
            Fault::DroppedIds(every) if index % every == 0 => None,
            _ => Some(id),
        });
        let picture = rasterize(&scene, view, arrived, self.placement);
        let mut cut = LevelCut::new(&scene, view, self.rule).drawables();
        order.sort(&scene, view, &mut cut);
        let truth = rasterize(&scene, view, cut, self.placement);
        let exact = truth.seen();
        let false_culled = exact.iter().copied().filter(|id| !emitted.contains(id)).collect();
        let differing_pixels = picture.differing_pixels(&truth);
        self.last = Some((emitted.clone(), picture.clone()));
        Ok(FrameReport { stats, occluders, emitted, exact, false_culled, differing_pixels, picture })
    }

    /// OR: the last frame's ids, mapped to this view's cut and drawn from it.
    fn draw_occluders(
        &self,
        scene: &Arc<Scene>,
        view: &View,
        ids: &[DrawableId],
        last: &Picture,
    ) -> Result<(Vec<DrawableId>, Picture), WalkError> {
        let mut due = Vec::new();
        if self.fault == Fault::OtherLevels {
            due.extend_from_slice(ids);
        } else {
            OccluderMapper::new(Arc::clone(scene), *view, self.rule).push(ids, &mut due)?;
        }
        let mut depth = match self.fault {
            Fault::StaleDepth if last.viewport() == view.viewport() => last.clone(),
            _ => rasterize(scene, view, due.iter().copied(), self.placement),
        };
        if let Fault::NearerOccluders(fraction) = self.fault {
            depth.bring_nearer(fraction);
        }
        Ok((due, depth))
    }

    /// HC.
    fn cull(
        &mut self,
        view: &View,
        depth: Option<&Picture>,
    ) -> Result<(Vec<DrawableId>, CullStats), WalkError> {
        let mut emitted = Vec::new();
        let fault = self.fault;
        let stats = match (depth, self.testing) {
            (None, _) => self.culler.cull(view, self.rule, &mut NoOccluders, |id| emitted.push(id))?,
            (Some(depth), Testing::Rasterized) => {
                let mut tester = Tampered { inner: ReferenceTester::new(depth), fault };
                self.culler.cull(view, self.rule, &mut tester, |id| emitted.push(id))?
            }
            (Some(depth), Testing::Pyramid) => {
                let values = depth.depth32();
                let mut pyramid = DepthPyramid::new();
                let size = |_| HzbError::Size { image: view.viewport(), other: Some(depth.viewport()) };
                let image = DepthImage::new(depth.viewport(), &values).map_err(size)?;
                pyramid.rebuild(image);
                let mut tester = Tampered { inner: HzbTester::new(image, &pyramid)?, fault };
                self.culler.cull(view, self.rule, &mut tester, |id| emitted.push(id))?
            }
        };
        Ok((emitted, stats))
    }
}

/// A tester whose boxes are tampered with as the fault says.
struct Tampered<T> {
    inner: T,
    fault: Fault,
}

impl<T: BoxTester> BoxTester for Tampered<T> {
    type Error = T::Error;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), T::Error> {
        let tampered = |test_box: &TestBox| match self.fault {
            Fault::SmallBoxes(scale) => TestBox { axes: test_box.axes.map(|axis| axis * scale), ..*test_box },
            Fault::NoInflation(fraction) => {
                let away = 1.0 + fraction;
                TestBox { centre: test_box.centre * away, axes: test_box.axes.map(|axis| axis * away) }
            }
            _ => *test_box,
        };
        let boxes: Vec<TestBox> = boxes.iter().map(tampered).collect();
        self.inner.test(view, &boxes, visible)
    }

    fn outline(&self) -> Outline {
        if self.fault == Fault::NoOutline { Outline::OnScreen } else { self.inner.outline() }
    }

    fn answer(&self) -> Answer {
        self.inner.answer()
    }
}
