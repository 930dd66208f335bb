//! The one order in which everyone draws.
//!
//! Where two surfaces have equal depth, the one drawn first (or last) wins. For a culled picture to equal the
//! unculled one there as well, any two drawables must be drawn in the same order whatever else is drawn: a
//! total order that does not depend on the set. This one is front to back, which also spares the fragments of
//! what is behind.

use glam::DVec3;
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::View;

/// Sorts drawables into drawing order, and keeps its memory between frames.
#[derive(Debug, Clone, Default)]
pub struct DrawOrder {
    keys: Vec<u64>,
}

impl DrawOrder {
    /// Sorts `ids` by the distance of the eye from their nodes' world boxes (0 inside; rounded to f32), then
    /// by id.
    pub fn sort(&mut self, scene: &Scene, view: &View, ids: &mut [DrawableId]) {
        let eye = view.eye();
        self.keys.clear();
        self.keys.extend(ids.iter().map(|&id| key(scene, eye, id)));
        self.keys.sort_unstable();
        for (slot, key) in ids.iter_mut().zip(&self.keys) {
            *slot = DrawableId((key & u64::from(u32::MAX)) as u32);
        }
    }
}

/// Sorts `ids` into drawing order: see [`DrawOrder::sort`], which keeps its memory.
pub fn draw_order(scene: &Scene, view: &View, ids: &mut [DrawableId]) {
    DrawOrder::default().sort(scene, view, ids);
}

/// The squared distance's bits, which order as it does, above the id. What the scene does not have comes
/// last.
fn key(scene: &Scene, eye: DVec3, id: DrawableId) -> u64 {
    let node =
        scene.drawables().get(id.index()).and_then(|drawable| scene.nodes().get(drawable.node as usize));
    let distance = node.map_or(f32::INFINITY, |node| node.distance_squared(eye) as f32);
    u64::from(distance.to_bits()) << 32 | u64::from(id.0)
}
