//! The boxes by which CHC++ queries nodes: often smaller than their own.

use glam::DVec3;
use trimaran_cull::{BoxMaker, LodCut, Outline, Prepared, TestBox};
use trimaran_scene::{Node, Scene};

use crate::culling::work::Seen;

/// A node is queried by boxes at most so many levels below it,
const DEEPEST: u32 = 3;
/// and of at most this much more surface.
const MOST_SURFACE: f64 = 1.4;

/// How the parts of a frame are found and tested.
pub(super) struct Tests<'s> {
    pub(super) cut: LodCut<'s>,
    pub(super) maker: BoxMaker,
    /// World metres.
    pub(super) eye: DVec3,
}

impl<'s> Tests<'s> {
    pub(super) fn new(scene: &'s Scene, seen: Seen<'_>) -> Self {
        Self {
            cut: LodCut::new(scene, seen.view, seen.rule),
            maker: BoxMaker::new(seen.view, Outline::InBox),
            eye: seen.view.eye(),
        }
    }

    /// The boxes below a node that would be refined, if they are hardly larger than its own. `None` if they
    /// are, or if one of them cannot be tested.
    pub(super) fn tight_boxes(&self, node: &Node) -> Option<Vec<TestBox>> {
        let most = MOST_SURFACE * surface(node);
        let nodes = self.cut.scene().nodes();
        let mut best = None;
        let mut level = vec![*node];
        for _ in 0..DEEPEST {
            let mut below = Vec::new();
            for node in &level {
                if node.is_leaf() {
                    below.push(*node);
                }
                let children = node.children().map(|id| nodes.get(id as usize).copied());
                let Some(children) = children.collect::<Option<Vec<Node>>>() else { return best };
                below.extend(children);
            }
            if below.len() == level.len() || below.iter().map(surface).sum::<f64>() > most {
                break;
            }
            let mut boxes = Vec::new();
            for node in &below {
                match self.maker.prepare(node) {
                    Prepared::Test(own) => boxes.push(own),
                    Prepared::Outside => {}
                    Prepared::Visible(_) => return best,
                }
            }
            (level, best) = (below, Some(boxes).filter(|boxes| !boxes.is_empty()));
        }
        best
    }
}

/// The surface of a node's world box, square metres.
fn surface(node: &Node) -> f64 {
    let (min, max) = node.world_box();
    let edges = max - min;
    2.0 * (edges.x * edges.y + edges.y * edges.z + edges.z * edges.x)
}
