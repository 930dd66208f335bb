//! A spatial tree over boxes: binned surface heuristic, collapsed to eight children.
//!
//! A box's size is the square of the sum of its edges: like its surface, but not zero for flat and line-like
//! boxes. If the boxes' centres coincide, or the tree grows too deep (centres ever closer together), the
//! items are halved in their order, so any input gives a tree of bounded depth. Outliers end up in subtrees
//! of their own near the root, and a huge box beside tiny ones becomes a child of the node they share.

use std::collections::VecDeque;
use std::ops::Range;

use super::linear::WorldBox;
use crate::lists::put;

/// The most children of a node.
const CHILDREN: usize = 8;
/// Bins along each axis.
const BINS: usize = 16;
/// Splits below this depth only halve.
const DEEPEST: usize = 48;

/// A node of the tree, in breadth-first order.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TreeNode {
    /// `None` for the root.
    pub(super) parent: Option<u32>,
    /// Empty for a leaf.
    pub(super) children: Range<u32>,
    /// The item of a leaf.
    pub(super) item: Option<u32>,
    /// The box around all items below.
    pub(super) bounds: WorldBox,
}

/// Builds the tree over at least one box. Each item is one leaf; a single item is the root.
pub(super) fn build(boxes: &[WorldBox]) -> Vec<TreeNode> {
    let binary = split(&mut items(boxes), 0);
    let node = |parent, of: &Binary| TreeNode { parent, children: 0..0, item: of.item, bounds: of.bounds };
    let mut nodes = vec![node(None, &binary)];
    let mut queue = VecDeque::from([(0_u32, &binary)]);
    while let Some((index, subtree)) = queue.pop_front() {
        let children = collapse(subtree);
        let first = nodes.len() as u32;
        for (child, place) in children.into_iter().zip(first..) {
            nodes.push(node(Some(index), child));
            queue.push_back((place, child));
        }
        let end = nodes.len() as u32;
        if let Some(node) = nodes.get_mut(index as usize).filter(|_| end > first) {
            node.children = first..end;
        }
    }
    nodes
}

/// The interior nodes, grouped by the longest path down to a leaf: a group needs only the groups before it.
pub(super) fn by_height(tree: &[TreeNode]) -> Vec<Vec<u32>> {
    let mut heights = vec![0_usize; tree.len()];
    let mut groups: Vec<Vec<u32>> = Vec::new();
    for (index, node) in tree.iter().enumerate().rev() {
        let tallest = node.children.clone().filter_map(|c| heights.get(c as usize)).max();
        let Some(height) = tallest.map(|tallest| tallest + 1) else { continue };
        put(&mut heights, index, height);
        if groups.len() < height {
            groups.resize_with(height, Vec::new);
        }
        if let Some(group) = groups.get_mut(height - 1) {
            group.push(index as u32);
        }
    }
    groups
}

/// Cuts the items into groups of at most `most` neighbours; items keep their order within a group.
pub(super) fn groups(boxes: &[WorldBox], most: usize) -> Vec<Vec<u32>> {
    let mut items = items(boxes);
    let mut groups = Vec::new();
    gather(&mut items, 0, most.max(1), &mut groups);
    groups
}

fn gather(items: &mut [Item], depth: usize, most: usize, groups: &mut Vec<Vec<u32>>) {
    if items.len() <= most {
        groups.push(items.iter().map(|item| item.index).collect());
        return;
    }
    let (left, right) = halve(items, depth);
    gather(left, depth + 1, most, groups);
    gather(right, depth + 1, most, groups);
}

fn items(boxes: &[WorldBox]) -> Vec<Item> {
    (0_u32..)
        .zip(boxes)
        .map(|(index, &bounds)| Item { index, bounds, centre: bounds.centre().to_array() })
        .collect()
}

#[derive(Debug, Clone, Copy)]
struct Item {
    index: u32,
    bounds: WorldBox,
    centre: [f64; 3],
}

/// The binary tree before it is collapsed.
#[derive(Debug)]
struct Binary {
    bounds: WorldBox,
    /// How many items it has.
    count: usize,
    /// The item of a leaf.
    item: Option<u32>,
    halves: Option<Box<[Self; 2]>>,
}

/// The children of a collapsed node: the largest inner ones are opened until there are eight. One whose items
/// all fit is opened whole.
fn collapse(subtree: &Binary) -> Vec<&Binary> {
    let Some(halves) = &subtree.halves else { return Vec::new() };
    let mut children: Vec<&Binary> = halves.iter().collect();
    while children.len() < CHILDREN {
        let inner = children.iter().enumerate().filter(|(_, child)| child.halves.is_some());
        let largest = inner
            .max_by(|(_, a), (_, b)| size(a.bounds).total_cmp(&size(b.bounds)).then(a.count.cmp(&b.count)));
        let Some((place, Some(halves))) = largest.map(|(place, child)| (place, &child.halves)) else { break };
        children.splice(place..=place, halves.iter());
    }
    children
}

fn size(bounds: WorldBox) -> f64 {
    let sum = (bounds.max - bounds.min).element_sum();
    sum * sum
}

fn split(items: &mut [Item], depth: usize) -> Binary {
    let bounds = items.iter().fold(WorldBox::EMPTY, |b, item| b.union(item.bounds));
    if let [item] = items {
        return Binary { bounds, count: 1, item: Some(item.index), halves: None };
    }
    let count = items.len();
    let (left, right) = halve(items, depth);
    let halves = if count > 4096 {
        rayon::join(|| split(left, depth + 1), || split(right, depth + 1))
    } else {
        (split(left, depth + 1), split(right, depth + 1))
    };
    Binary { bounds, count, item: None, halves: Some(Box::new(halves.into())) }
}

/// Divides at least two items by the best plane, or in their order without one.
fn halve(items: &mut [Item], depth: usize) -> (&mut [Item], &mut [Item]) {
    let cut = if depth < DEEPEST { best_cut(items) } else { None };
    let middle = match cut {
        Some(cut) => partition(items, |item| cut.bin(item) < cut.at),
        None => items.len() / 2,
    };
    items.split_at_mut(middle)
}

/// Moves the `wanted` items to the front, keeping the order within both parts; returns their number.
fn partition(items: &mut [Item], wanted: impl Fn(&Item) -> bool) -> usize {
    let (front, back): (Vec<Item>, Vec<Item>) = items.iter().partition(|item| wanted(item));
    for (slot, item) in items.iter_mut().zip(front.iter().chain(&back)) {
        *slot = *item;
    }
    front.len()
}

/// A plane between two bins.
#[derive(Debug, Clone, Copy)]
struct Cut {
    axis: usize,
    low: f64,
    scale: f64,
    /// Bins below this go left.
    at: usize,
}

impl Cut {
    fn bin(&self, item: &Item) -> usize {
        // The cast saturates, and NaN becomes 0.
        (((item.centre[self.axis] - self.low) * self.scale) as usize).min(BINS - 1)
    }
}

/// The plane with the least sum of (count x size); `None` if all centres coincide.
fn best_cut(items: &[Item]) -> Option<Cut> {
    let mut best: Option<(f64, Cut)> = None;
    for axis in 0..3 {
        let low = items.iter().fold(f64::INFINITY, |m, item| m.min(item.centre[axis]));
        let high = items.iter().fold(f64::NEG_INFINITY, |m, item| m.max(item.centre[axis]));
        let scale = BINS as f64 / (high - low);
        if !scale.is_finite() || scale <= 0.0 {
            continue;
        }
        let mut cut = Cut { axis, low, scale, at: 0 };
        let mut bins = [(0_usize, WorldBox::EMPTY); BINS];
        for item in items {
            let (count, bounds) = &mut bins[cut.bin(item)];
            *count += 1;
            *bounds = bounds.union(item.bounds);
        }
        for (at, cost) in costs(&bins) {
            cut.at = at;
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, cut));
            }
        }
    }
    best.map(|(_, cut)| cut)
}

/// The cost of each plane that leaves items on both sides.
fn costs(bins: &[(usize, WorldBox); BINS]) -> impl Iterator<Item = (usize, f64)> {
    let cost = |count: usize, bounds: WorldBox| if count == 0 { 0.0 } else { count as f64 * size(bounds) };
    let mut right = [(0, 0.0); BINS];
    let (mut count, mut bounds) = (0, WorldBox::EMPTY);
    for (slot, bin) in right.iter_mut().zip(bins).rev() {
        (count, bounds) = (count + bin.0, bounds.union(bin.1));
        *slot = (count, cost(count, bounds));
    }
    let (mut count, mut bounds) = (0, WorldBox::EMPTY);
    let mut left = [(0, 0.0); BINS];
    for (slot, bin) in left.iter_mut().zip(bins) {
        (count, bounds) = (count + bin.0, bounds.union(bin.1));
        *slot = (count, cost(count, bounds));
    }
    (1..BINS).filter_map(move |at| {
        let ((left_count, left_cost), (right_count, right_cost)) = (left[at - 1], right[at]);
        (left_count > 0 && right_count > 0).then_some((at, left_cost + right_cost))
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn cube(x: f64, y: f64, z: f64, half: f64) -> WorldBox {
        let centre = DVec3::new(x, y, z);
        WorldBox { min: centre - half, max: centre + half }
    }

    /// Asserts: every item once, at most eight children, parents around children. Returns the greatest depth.
    fn checked(boxes: &[WorldBox]) -> usize {
        let tree = build(boxes);
        let mut items: Vec<u32> = tree.iter().filter_map(|node| node.item).collect();
        items.sort_unstable();
        assert_eq!(items, (0..boxes.len() as u32).collect::<Vec<_>>());
        let mut depths = vec![0; tree.len()];
        for (index, node) in tree.iter().enumerate() {
            assert_eq!(node.item.is_some(), node.children.is_empty());
            assert!(node.children.len() <= CHILDREN && node.children.len() != 1);
            for child in node.children.clone() {
                let child = child as usize;
                assert!(child > index && tree[child].parent == Some(index as u32));
                assert_eq!(node.bounds.union(tree[child].bounds), node.bounds);
                depths[child] = depths[index] + 1;
            }
        }
        depths.into_iter().max().unwrap_or_default()
    }

    #[test]
    fn one_two_and_many_items() {
        for count in [1, 2, 8, 9, 1000] {
            let boxes: Vec<_> =
                (0..count).map(|i| cube(f64::from(i % 10), f64::from(i / 10), 0.0, 0.4)).collect();
            checked(&boxes);
        }
    }

    #[test]
    fn coincident_boxes_make_a_shallow_tree() {
        assert!(checked(&vec![cube(1.0, 2.0, 3.0, 0.5); 4096]) <= 6);
    }

    #[test]
    fn centres_ever_closer_together_do_not_make_a_chain() {
        let boxes: Vec<_> = (0..2000).map(|i| cube(2.0_f64.powi(-i / 2), 0.0, 0.0, 0.0)).collect();
        assert!(checked(&boxes) <= 60);
    }

    #[test]
    fn a_giant_and_an_outlier_stay_near_the_root() {
        let mut boxes: Vec<_> =
            (0..512).map(|i| cube(f64::from(i % 8), f64::from(i / 8 % 8), f64::from(i / 64), 0.1)).collect();
        boxes.push(cube(4.0, 4.0, 4.0, 50.0));
        boxes.push(cube(1e7, 0.0, 0.0, 0.1));
        let tree = build(&boxes);
        let depth = |item: u32| {
            let mut at = tree.iter().position(|node| node.item == Some(item));
            let mut depth = 0;
            while let Some(parent) = at.and_then(|at| tree[at].parent) {
                (at, depth) = (Some(parent as usize), depth + 1);
            }
            depth
        };
        assert_eq!(depth(513), 1, "the outlier");
        assert!(depth(512) <= 2, "the giant is at depth {}", depth(512));
        checked(&boxes);
    }

    #[test]
    fn huge_coordinates_still_make_a_tree() {
        checked(&[cube(1e300, 0.0, 0.0, 1.0), cube(-1e300, 0.0, 0.0, 1.0), cube(0.0, 1e-300, 0.0, 0.0)]);
    }
}
