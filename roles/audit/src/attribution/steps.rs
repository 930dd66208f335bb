//! The steps that a culler takes with a node, one by one, so that they can be judged.

use trimaran_cull::{BoxMaker, CutRule, LodCut, OcclusionTest, Outline, Prepared, TestBox, View, reaches};
use trimaran_scene::{Node, NodeId, Scene};

/// What HC's traversal does with one node.
pub(super) trait Steps {
    type Error;

    /// Whether the node is outside the frustum, by its world box.
    fn outside(&self, node: &Node) -> bool;

    /// What becomes of the node before any test.
    fn prepare(&self, id: NodeId, node: &Node) -> Prepared;

    /// Whether the occlusion test says that the box shows.
    fn shows(&mut self, test_box: TestBox) -> Result<bool, Self::Error>;

    /// The node's box without its half pixel, if it can be tested.
    fn bare(&self, id: NodeId, node: &Node) -> Option<TestBox>;

    /// How far the node's box is inflated against rounding and depth ties, metres.
    fn slack(&self, id: NodeId, node: &Node) -> f64;
}

/// The steps as [`Culler`](trimaran_cull::Culler) takes them.
pub(super) struct CullerSteps<'f, T> {
    cut: LodCut<'f>,
    maker: BoxMaker,
    reach: Vec<f32>,
    view: &'f View,
    test: &'f mut T,
    answers: Vec<u32>,
}

impl<'f, T: OcclusionTest> CullerSteps<'f, T> {
    pub(super) fn new(scene: &'f Scene, view: &'f View, rule: &CutRule, test: &'f mut T) -> Self {
        Self {
            cut: LodCut::new(scene, view, rule),
            maker: BoxMaker::new(view, test.outline()),
            reach: reaches(scene.nodes()),
            view,
            test,
            answers: Vec::new(),
        }
    }

    fn reach(&self, id: NodeId) -> f64 {
        self.reach.get(id.0 as usize).copied().unwrap_or(f32::NAN).into()
    }
}

impl<T: OcclusionTest> Steps for CullerSteps<'_, T> {
    type Error = T::Error;

    fn outside(&self, node: &Node) -> bool {
        self.cut.outside(node)
    }

    fn prepare(&self, id: NodeId, node: &Node) -> Prepared {
        self.maker.prepare(node, self.reach(id))
    }

    fn shows(&mut self, test_box: TestBox) -> Result<bool, T::Error> {
        self.test.test(self.view, &[test_box], &mut self.answers)?;
        Ok(self.answers != [0])
    }

    fn bare(&self, id: NodeId, node: &Node) -> Option<TestBox> {
        match BoxMaker::new(self.view, Outline::OnScreen).prepare(node, self.reach(id)) {
            Prepared::Test(test_box) => Some(test_box),
            _ => None,
        }
    }

    fn slack(&self, id: NodeId, node: &Node) -> f64 {
        self.maker.slack(node, self.reach(id))
    }
}
