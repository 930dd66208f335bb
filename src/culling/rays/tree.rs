//! Boxes under a tree, and how rays go down it.

use std::ops::Range;

use glam::Vec4;
use obvhs::{
    Boundable, BvhBuildParams,
    bvh2::{Bvh2, leaf_collapser::collapse, node::Bvh2Node, reinsertion::ReinsertionOptimizer},
    ploc::PlocBuilder,
};

use super::packet::Packet;

/// A tree of boxes. Siblings stand side by side; the root is the first.
#[derive(Default)]
pub(super) struct Tree {
    nodes: Box<[Bvh2Node]>,
}

/// Built in a time in which a frame can be drawn, and gone through as fast, but for a few percent, as a tree
/// that took twice as long.
const BUILDING: BvhBuildParams = BvhBuildParams::fast_build();

impl Tree {
    /// A tree over things that have boxes, with at most `most` of them in a leaf. What it calls the first, the
    /// second and so on of them is in the order that it gives.
    pub(super) fn over<T: Boundable>(things: &[T], most: u32) -> (Self, Vec<u32>) {
        let count = u32::try_from(things.len()).unwrap_or(u32::MAX);
        let BvhBuildParams { ploc_search_distance, sort_precision, search_depth_threshold, .. } = BUILDING;
        let mut tree = PlocBuilder::new().build(
            ploc_search_distance,
            things,
            (0..count).collect(),
            sort_precision,
            search_depth_threshold,
        );
        ReinsertionOptimizer::default().run(&mut tree, BUILDING.reinsertion_batch_ratio, None);
        collapse(&mut tree, most, BUILDING.collapse_traversal_cost);
        let Bvh2 { nodes, primitive_indices, .. } = tree;
        (Self { nodes: nodes.into() }, primitive_indices)
    }

    /// Calls `leaf` with what is in the leaves that a ray of `packet` enters by `end`, nearer ones first as far
    /// as boxes tell. `leaf` may bring `end` nearer. `stack` is memory to work with.
    #[inline]
    pub(super) fn visit(
        &self,
        packet: &Packet,
        end: &mut Vec4,
        stack: &mut Vec<u32>,
        mut leaf: impl FnMut(Range<usize>, &mut Vec4),
    ) {
        stack.clear();
        let Some(root) = self.nodes.first() else { return };
        if packet.enters(root.aabb(), *end) == f32::INFINITY {
            return;
        }
        if root.is_leaf() {
            return leaf(contents(root), end);
        }
        let mut next = Some(root.first_index);
        while let Some(index) = next {
            let Some([near, far]) = self.siblings(index) else { return };
            let (mut near, mut far) = (near, far);
            let (mut to_near, mut to_far) =
                (packet.enters(near.aabb(), *end), packet.enters(far.aabb(), *end));
            if to_near > to_far {
                (near, far) = (far, near);
                (to_near, to_far) = (to_far, to_near);
            }
            next = None;
            if to_near < f32::INFINITY {
                if near.is_leaf() {
                    leaf(contents(near), end);
                } else {
                    next = Some(near.first_index);
                }
            }
            if to_far <= end.max_element() {
                if far.is_leaf() {
                    leaf(contents(far), end);
                } else if next.is_some() {
                    stack.push(far.first_index);
                } else {
                    next = Some(far.first_index);
                }
            }
            next = next.or_else(|| stack.pop());
        }
    }

    fn siblings(&self, first: u32) -> Option<[&Bvh2Node; 2]> {
        match self.nodes.get(first as usize..)? {
            [near, far, ..] => Some([near, far]),
            _ => None,
        }
    }
}

fn contents(leaf: &Bvh2Node) -> Range<usize> {
    let first = leaf.first_index as usize;
    first..first + leaf.prim_count as usize
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3A};
    use obvhs::aabb::Aabb;
    use trimaran_scene::random::Random;

    use super::*;

    /// What rays from `origin` come to, and what they enter.
    fn visited(boxes: &[Aabb], packet: &Packet, mut end: Vec4) -> (Vec<u32>, Vec<u32>) {
        let (tree, order) = Tree::over(boxes, 1);
        let mut visited = Vec::new();
        tree.visit(packet, &mut end, &mut Vec::new(), |leaf, _| visited.extend_from_slice(&order[leaf]));
        visited.sort_unstable();
        let enters = |index: &u32| packet.enters(&boxes[*index as usize], end) < f32::INFINITY;
        (visited, (0..).take(boxes.len()).filter(enters).collect())
    }

    #[test]
    fn rays_come_to_each_box_that_they_enter_once() {
        let mut random = Random::new(4);
        for count in [0, 1, 2, 3, 300] {
            let mut point = |reach: f64| random.point(DVec3::splat(-reach), DVec3::splat(reach)).as_vec3a();
            let boxes: Vec<Aabb> = (0..count)
                .map(|_| (point(9.0), point(1.0).abs()))
                .map(|(at, half)| Aabb::new(at - half, at + half))
                .collect();
            for _ in 0..50 {
                let (origin, towards) = (point(20.0), point(9.0));
                let directions = [(); 4].map(|()| towards + point(0.3) - origin);
                let packet = Packet::new(origin, directions, Vec4::splat(0.1));
                let (visited, enters) = visited(&boxes, &packet, Vec4::new(1.0, 0.8, 2.0, -1.0));
                assert_eq!(visited, enters);
            }
        }
    }

    #[test]
    fn boxes_all_in_the_same_place_are_all_come_to() {
        // A tree that halves nothing: deeper than the stacks of fixed size that rays are often given.
        let boxes = vec![Aabb::new(Vec3A::splat(-1.0), Vec3A::ONE); 3000];
        let packet = Packet::new(Vec3A::splat(-3.0), [Vec3A::ONE; 4], Vec4::ZERO);
        let (visited, enters) = visited(&boxes, &packet, Vec4::splat(9.0));
        assert_eq!((visited.len(), enters.len()), (3000, 3000));
    }

    #[test]
    fn nearer_boxes_come_first_and_what_is_beyond_a_hit_is_passed_by() {
        let boxes: Vec<Aabb> = (0..64)
            .map(|at| Aabb::new(Vec3A::new(at as f32, -1.0, -1.0), Vec3A::new(at as f32, 1.0, 1.0)))
            .collect();
        let (tree, order) = Tree::over(&boxes, 1);
        for (from, along, nearest) in [(-2.0, Vec3A::X, 0), (70.0, Vec3A::NEG_X, 63)] {
            let packet = Packet::new(Vec3A::X * from, [along; 4], Vec4::ZERO);
            let mut visited = Vec::new();
            tree.visit(&packet, &mut Vec4::splat(1e30), &mut Vec::new(), |leaf, end| {
                visited.extend_from_slice(&order[leaf]);
                *end = end.min(Vec4::splat(packet.enters(&boxes[nearest], *end)));
            });
            assert_eq!(visited, [nearest as u32]);
        }
    }
}
