//! A tree of boxes, and its traversal by rays.

use std::ops::Range;

use glam::Vec4;
use obvhs::{
    Boundable, BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, leaf_collapser::collapse, node::Bvh2Node, reinsertion::ReinsertionOptimizer},
    ploc::PlocBuilder,
};

use super::packet::Packet;

/// A tree of boxes. Siblings stand side by side; the root is the first.
#[derive(Default)]
pub(crate) struct Tree {
    nodes: Box<[Bvh2Node]>,
}

/// Fast to build, within a frame's time, and only a few percent slower to traverse than a tree that takes
/// twice as long.
const BUILDING: BvhBuildParams = BvhBuildParams::fast_build();

/// The most by which a box is widened: a fraction of its size, and of its distance from the origin.
const WIDER: (f32, f32) = (1e-3, 1e-6);

impl Tree {
    /// A tree over boxed things, with at most `most` of them in a leaf. Also returns the order in which the
    /// tree numbers them.
    pub(crate) fn over<T: Boundable>(things: &[T], most: u32) -> (Self, Vec<u32>) {
        let count = u32::try_from(things.len()).unwrap_or(u32::MAX);
        let BvhBuildParams { ploc_search_distance, sort_precision, search_depth_threshold, .. } = BUILDING;
        let boxes: Vec<Aabb> =
            (0..).zip(things).map(|(index, thing)| widened(&thing.aabb(), index)).collect();
        let mut tree = PlocBuilder::new().build(
            ploc_search_distance,
            &boxes,
            (0..count).collect(),
            sort_precision,
            search_depth_threshold,
        );
        ReinsertionOptimizer::default().run(&mut tree, BUILDING.reinsertion_batch_ratio, None);
        collapse(&mut tree, most, BUILDING.collapse_traversal_cost);
        let Bvh2 { nodes, primitive_indices, .. } = tree;
        (Self { nodes: nodes.into() }, primitive_indices)
    }

    /// Calls `leaf` with the leaves that a ray of `packet` enters by `end`, roughly from near to far. `leaf`
    /// may bring `end` nearer. `stack` is working memory.
    #[inline]
    pub(crate) fn visit(
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

/// The box widened slightly, each by a different amount. The crate builds a tree in passes that join the best
/// pairs of neighbours. With equal boxes that is one pair per pass, and the tree is as deep as there are
/// boxes.
fn widened(bounds: &Aabb, index: u32) -> Aabb {
    // Multiples of the golden ratio are spread evenly between 0 and 1.
    let share = index.wrapping_mul(0x9e37_79b9) as f32 / u32::MAX as f32;
    let distance = bounds.min.abs().max(bounds.max.abs());
    let by = (bounds.diagonal() * WIDER.0 + distance * WIDER.1) * share;
    Aabb::new(bounds.min - by, bounds.max + by)
}

fn contents(leaf: &Bvh2Node) -> Range<usize> {
    let first = leaf.first_index as usize;
    first..first + leaf.prim_count as usize
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3A};
    use trimaran_scene::random::Random;

    use super::*;

    impl Tree {
        fn depth(&self, index: u32) -> usize {
            let node = &self.nodes[index as usize];
            if node.is_leaf() {
                return 1;
            }
            1 + self.depth(node.first_index).max(self.depth(node.first_index + 1))
        }

        /// The content of the leaves that rays enter, sorted by index.
        fn entered(&self, order: &[u32], packet: &Packet, mut end: Vec4) -> Vec<u32> {
            let mut entered = Vec::new();
            self.visit(packet, &mut end, &mut Vec::new(), |leaf, _| entered.extend_from_slice(&order[leaf]));
            entered.sort_unstable();
            entered
        }
    }

    #[test]
    fn rays_come_to_each_box_that_they_enter_once() {
        let mut random = Random::new(4);
        for count in [0, 1, 2, 3, 300] {
            let mut point = |reach: f64| random.point(DVec3::splat(-reach), DVec3::splat(reach)).as_vec3a();
            let mut cuboid = |_| {
                let (middle, half) = (point(9.0), point(1.0).abs());
                Aabb::new(middle - half, middle + half)
            };
            let boxes: Vec<Aabb> = (0..count).map(&mut cuboid).collect();
            let (tree, order) = Tree::over(&boxes, 1);
            for _ in 0..50 {
                let (origin, towards) = (point(20.0), point(9.0));
                let packet =
                    Packet::new(origin, [(); 4].map(|()| towards + point(0.3) - origin), Vec4::splat(0.1));
                let end = Vec4::new(1.0, 0.8, 2.0, -1.0);
                let entered = tree.entered(&order, &packet, end);
                let wider = |index: &u32| widened(&boxes[*index as usize], *index);
                let enters = |bounds: &Aabb| packet.enters(bounds, end) < f32::INFINITY;
                assert_eq!(entered, (0..count).filter(|index| enters(&wider(index))).collect::<Vec<_>>());
                let exact = (0..count).filter(|index| enters(&boxes[*index as usize]));
                assert!(exact.into_iter().all(|index| entered.contains(&index)));
            }
        }
    }

    #[test]
    fn a_tree_of_boxes_that_are_all_alike_is_not_deep() {
        let unit = Aabb::new(Vec3A::splat(-1.0), Vec3A::ONE);
        let packet = Packet::new(Vec3A::new(-3.0, 0.0, 0.0), [Vec3A::X; 4], Vec4::ZERO);
        for step in [0.0, 2.0] {
            let along = |index: u16| Vec3A::X * step * f32::from(index);
            let boxes: Vec<Aabb> =
                (0..4000).map(|index| Aabb::new(unit.min + along(index), unit.max + along(index))).collect();
            let (tree, order) = Tree::over(&boxes, 1);
            assert!(tree.depth(0) < 200, "{}", tree.depth(0));
            assert_eq!(tree.entered(&order, &packet, Vec4::splat(1e30)).len(), 4000);
        }
    }

    #[test]
    fn nearer_boxes_come_first_and_what_is_beyond_a_hit_is_passed_by() {
        let slice = |at: u16| {
            let at = f32::from(at);
            Aabb::new(Vec3A::new(at, -1.0, -1.0), Vec3A::new(at, 1.0, 1.0))
        };
        let boxes: Vec<Aabb> = (0..64).map(slice).collect();
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
