//! Occluder selection: which of the cut to draw as occluders. Any subset of it is valid, so this trades the
//! time to draw them for looser culling, and never a hole.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;
use trimaran_proto::DrawableId;
use trimaran_scene::{Node, NodeId, Scene};

use crate::{Choice, LodCut, LodRule, View};

/// At most so many triangles of occluders.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TriangleBudget(pub u64);

/// Keeps the drawables that hide most for their triangles, as long as they fit the budget: by the square of
/// how large they look (the box's diagonal over its distance), a triangle. What the scene does not have is
/// dropped.
pub fn select_occluders(scene: &Scene, view: &View, ids: &mut Vec<DrawableId>, budget: TriangleBudget) {
    let eye = view.eye();
    let mut ranked: Vec<(f32, DrawableId, u64)> = ids
        .iter()
        .filter_map(|&id| {
            let drawable = scene.drawables().get(id.index())?;
            let node = scene.nodes().get(drawable.node as usize)?;
            let triangles = u64::from(drawable.index_count / 3);
            let (min, max) = node.world_box();
            let size = (max - min).length_squared() / distance_squared(node, eye);
            Some(((size / triangles.max(1) as f64) as f32, id, triangles))
        })
        .collect();
    ids.clear();
    if ranked.iter().map(|(_, _, triangles)| triangles).sum::<u64>() > budget.0 {
        ranked.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    }
    let mut left = budget.0;
    for (_, id, triangles) in ranked {
        if triangles <= left {
            left -= triangles;
            ids.push(id);
        }
    }
}

/// Appends the drawables of the cut that are nearest to the eye, nearest first, until the next one would pass
/// the budget.
///
/// These are the occluders of a frame that has no frame before it to take them from: the first one, or one
/// after a jump.
pub fn nearest_occluders(
    scene: &Scene,
    view: &View,
    rule: LodRule,
    budget: TriangleBudget,
    ids: &mut Vec<DrawableId>,
) {
    let cut = LodCut::new(scene, view, rule);
    let eye = view.eye();
    // Squared distances are not negative, so their bits order as they do. NaN comes last.
    let entry = |id: NodeId| {
        let distance =
            scene.nodes().get(id.0 as usize).map_or(f64::INFINITY, |node| distance_squared(node, eye));
        Reverse((distance.to_bits(), id))
    };
    let mut heap = BinaryHeap::new();
    if !scene.nodes().is_empty() {
        heap.push(entry(NodeId(0)));
    }
    let mut left = budget.0;
    while let Some(Reverse((_, id))) = heap.pop() {
        let Some(node) = scene.nodes().get(id.0 as usize).filter(|node| !cut.outside(node)) else { continue };
        match cut.choose(node) {
            Choice::Refine => heap.extend(node.children().map(|child| entry(NodeId(child)))),
            Choice::Draw(id) => {
                let triangles = scene.drawables().get(id.index()).map_or(0, |d| u64::from(d.index_count / 3));
                if triangles > left {
                    return;
                }
                left -= triangles;
                ids.push(id);
            }
        }
    }
}

/// The squared distance of the eye from a node's world box, square metres; 0 inside.
fn distance_squared(node: &Node, eye: DVec3) -> f64 {
    let (min, max) = node.world_box();
    (min - eye).max(eye - max).max(DVec3::ZERO).length_squared()
}
