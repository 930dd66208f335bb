//! Faults for tests: each breaks one condition of exact culling.

use trimaran_cull::{Answer, HzbError, HzbTest, OcclusionTest, Outline, TestBox, View};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::ReferenceTest;

/// One of the conditions of exact culling, broken.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Fault {
    /// None: all conditions hold.
    #[default]
    None,
    /// Condition 1: OR draws the received levels instead of those of its own cut.
    OtherLevels,
    /// Condition 1: RVG draws one node in this many at another level than received.
    OtherLevelsShown(usize),
    /// As if OR had drawn from the previous camera: its depth is the last frame's.
    StaleDepth,
    /// Condition 3: boxes are tested this much smaller than they were given.
    SmallBoxes(f32),
    /// Condition 3: boxes are not inflated against ties, but lie this fraction farther away.
    NoInflation(f32),
    /// Condition 3: boxes are not grown by half a pixel.
    NoOutline,
    /// Condition 4: one id in this many never arrives at RVG.
    DroppedIds(usize),
    /// Condition 5: OR's vertices are this fraction nearer to the eye than RVG's.
    NearerOccluders(f64),
}

impl Fault {
    /// RVG's set for the ids that HC sent it.
    pub(crate) fn arrived(self, scene: &Scene, sent: &[DrawableId]) -> Vec<DrawableId> {
        let other_level = |id: DrawableId| {
            let drawable = scene.drawables().get(id.index())?;
            let other =
                scene.levels(scene.nodes().get(drawable.node as usize)?).find(|level| !level.holds(id));
            Some(other?.first())
        };
        sent.iter()
            .enumerate()
            .filter_map(|(index, &id)| match self {
                Self::DroppedIds(every) if index % every == 0 => None,
                Self::OtherLevelsShown(every) if index % every == 0 => Some(other_level(id).unwrap_or(id)),
                _ => Some(id),
            })
            .collect()
    }

    fn tampered(self, test_box: &TestBox) -> TestBox {
        match self {
            Self::SmallBoxes(scale) => TestBox { axes: test_box.axes.map(|axis| axis * scale), ..*test_box },
            Self::NoInflation(fraction) => {
                let away = 1.0 + fraction;
                TestBox { centre: test_box.centre * away, axes: test_box.axes.map(|axis| axis * away) }
            }
            _ => *test_box,
        }
    }
}

/// A culler's occlusion test.
pub(crate) enum AnyTest<'p> {
    Rasterized(ReferenceTest<'p>),
    Pyramid(HzbTest<'p>),
}

/// An occlusion test whose boxes are altered by the fault.
pub(crate) struct Tampered<'p> {
    pub(crate) inner: AnyTest<'p>,
    pub(crate) fault: Fault,
}

impl OcclusionTest for Tampered<'_> {
    type Error = HzbError;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), HzbError> {
        let boxes: Vec<TestBox> = boxes.iter().map(|test_box| self.fault.tampered(test_box)).collect();
        match &mut self.inner {
            AnyTest::Rasterized(test) => test.test(view, &boxes, visible).map_err(|never| match never {}),
            AnyTest::Pyramid(test) => test.test(view, &boxes, visible),
        }
    }

    fn outline(&self) -> Outline {
        match &self.inner {
            _ if self.fault == Fault::NoOutline => Outline::OnScreen,
            AnyTest::Rasterized(test) => test.outline(),
            AnyTest::Pyramid(test) => test.outline(),
        }
    }

    fn answer(&self) -> Answer {
        match &self.inner {
            AnyTest::Rasterized(test) => test.answer(),
            AnyTest::Pyramid(test) => test.answer(),
        }
    }
}
