//! A culler's steps on a node, one by one, for checking.

use trimaran_cull::{BoxMaker, CutRule, LodCut, OcclusionTest, Outline, Prepared, TestBox, View};
use trimaran_scene::{Node, Scene};

/// The steps of HC's traversal on one node.
pub(super) trait Steps {
    type Error;

    /// Whether the node is outside the frustum, by its world box.
    fn outside(&self, node: &Node) -> bool;

    /// The classification of the node before any test.
    fn prepare(&self, node: &Node) -> Prepared;

    /// Whether the occlusion test finds the box visible.
    fn shows(&mut self, test_box: TestBox) -> Result<bool, Self::Error>;

    /// The node's box without its half pixel, if it can be tested.
    fn bare(&self, node: &Node) -> Option<TestBox>;

    /// How far the node's box is inflated for rounding and depth ties, metres.
    fn slack(&self, node: &Node) -> f64;
}

/// The steps as [`Culler`](trimaran_cull::Culler) takes them.
pub(super) struct CullerSteps<'f, T> {
    cut: LodCut<'f>,
    maker: BoxMaker,
    view: &'f View,
    test: &'f mut T,
    answers: Vec<u32>,
}

impl<'f, T: OcclusionTest> CullerSteps<'f, T> {
    pub(super) fn new(scene: &'f Scene, view: &'f View, rule: &CutRule, test: &'f mut T) -> Self {
        Self {
            cut: LodCut::new(scene, view, rule),
            maker: BoxMaker::new(view, test.outline()),
            view,
            test,
            answers: Vec::new(),
        }
    }
}

impl<T: OcclusionTest> Steps for CullerSteps<'_, T> {
    type Error = T::Error;

    fn outside(&self, node: &Node) -> bool {
        self.cut.outside(node)
    }

    fn prepare(&self, node: &Node) -> Prepared {
        self.maker.prepare(node)
    }

    fn shows(&mut self, test_box: TestBox) -> Result<bool, T::Error> {
        self.test.test(self.view, &[test_box], &mut self.answers)?;
        Ok(self.answers != [0])
    }

    fn bare(&self, node: &Node) -> Option<TestBox> {
        match BoxMaker::new(self.view, Outline::OnScreen).prepare(node) {
            Prepared::Test(test_box) => Some(test_box),
            _ => None,
        }
    }

    fn slack(&self, node: &Node) -> f64 {
        self.maker.slack(node)
    }
}
