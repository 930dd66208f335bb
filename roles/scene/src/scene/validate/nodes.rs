//! The tree: nodes in breadth-first order, and their boxes.

use super::super::layout::{Firsts, Section};
use super::super::{Node, Scene};
use super::{Check, SceneError, malformed};

/// Breadth-first order: the children of node 0, then those of node 1, and so on, without a gap; each has the
/// right parent, and likewise with the drawables. Leaves have a level and an object.
///
/// Checks the nodes of a page, whose first node has index `first`.
pub(super) fn check(scene: &Scene, first: usize, nodes: &[Node]) -> Result<(), SceneError> {
    // In this page, or in an earlier one.
    let find = |index: usize| match index.checked_sub(first) {
        Some(within) => nodes.get(within),
        None => scene.nodes().get(index),
    };
    let [mut next, end] = scene.file().firsts(first >> Section::Nodes.page_bits());
    for (index, node) in (first..).zip(nodes) {
        let own = || {
            check_next(scene, index, node, next)?;
            check_boxes(node)?;
            check_kind(scene, node)?;
            check_place(index, node, find)
        };
        own().map_err(malformed("node", index))?;
        next = next.after(node);
    }
    let last = first + nodes.len().saturating_sub(1);
    if next.child != end.child {
        Err(malformed("node", last)("the children after its own are not next in breadth-first order"))
    } else if next.drawable != end.drawable {
        Err(malformed("drawable", next.drawable as usize)("its node does not have it among its levels"))
    } else if next.leaf != end.leaf {
        Err(malformed("node", last)("the leaves up to it are not as many as the directory says"))
    } else {
        Ok(())
    }
}

/// Whether the node's children and levels are the next ones.
fn check_next(scene: &Scene, index: usize, node: &Node, next: Firsts) -> Check {
    let within = |first: u32, count: u32, all: usize| u64::from(first) + u64::from(count) <= all as u64;
    if !node.is_leaf() && (node.first_child != next.child || node.first_child as usize <= index) {
        Err("its children are not next in breadth-first order")
    } else if !node.is_leaf() && !within(node.first_child, node.child_count, scene.nodes().len()) {
        Err("its children lie past the last node")
    } else if node.drawable_count > 0 && node.first_drawable != next.drawable {
        Err("its levels are not next to those of the node before it")
    } else if !within(node.first_drawable, node.drawable_count, scene.drawables().len()) {
        Err("its levels lie past the last drawable")
    } else {
        Ok(())
    }
}

/// Whether a node and its parent agree.
fn check_place<'n>(index: usize, node: &Node, find: impl Fn(usize) -> Option<&'n Node>) -> Check {
    if index == 0 {
        let is_root = node.parent == Node::NONE && node.depth == 0;
        return if is_root { Ok(()) } else { Err("it is the root but has a parent") };
    }
    // A parent stands before its children, so it was checked already.
    let parent = Some(node.parent as usize).filter(|parent| *parent < index).and_then(find);
    let parent = parent.filter(|parent| {
        let children = parent.first_child..parent.first_child.saturating_add(parent.child_count);
        children.contains(&(index as u32))
    });
    match parent {
        None => Err("its parent is not the node whose child it is"),
        Some(parent) if parent.object != Node::NONE && node.object != parent.object => {
            Err("it is not of the object whose part it is")
        }
        Some(parent) if !contains(parent, node) => Err("its box sticks out of its parent's"),
        Some(parent) if node.depth != parent.depth.saturating_add(1) => {
            Err("it is not one deeper than its parent")
        }
        Some(_) if node.depth > Node::DEEPEST => Err("it is deeper in the tree than any may be"),
        // Neither is NaN: that was checked.
        Some(parent) if node.reach > parent.reach => Err("its vertices reach farther than its parent's"),
        Some(_) => Ok(()),
    }
}

fn contains(outer: &Node, inner: &Node) -> bool {
    (0..3).all(|a| outer.world_min[a] <= inner.world_min[a] && outer.world_max[a] >= inner.world_max[a])
}

fn check_boxes(node: &Node) -> Check {
    let world_ordered = (0..3).all(|a| node.world_min[a] <= node.world_max[a]);
    let local_ordered = (0..3).all(|a| node.local_min[a] <= node.local_max[a]);
    let finite = [node.world_min, node.world_max, node.origin].iter().flatten().all(|c| c.is_finite())
        && [node.local_min, node.local_max].iter().flatten().all(|c| c.is_finite())
        && node.linear.iter().all(|c| c.is_finite());
    if !finite {
        Err("its box, origin or matrix has a value that is not finite")
    } else if !world_ordered || !local_ordered {
        Err("its box has a lower corner above the upper one")
    } else if node.reach.is_nan() || node.reach < node.own_reach() {
        Err("its vertices reach farther than it says")
    } else {
        Ok(())
    }
}

/// Whether the node has the right levels and object.
fn check_kind(scene: &Scene, node: &Node) -> Check {
    let has_object = (node.object as usize) < scene.objects().len();
    if node.is_leaf() && node.drawable_count == 0 {
        Err("it is a leaf without a drawable")
    } else if node.is_leaf() && !has_object {
        Err("it is a leaf whose object does not exist")
    } else if node.object != Node::NONE && !has_object {
        Err("its object does not exist")
    } else if node.object == Node::NONE && node.linear != [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] {
        Err("it stands for several objects, but its matrix is not the identity")
    } else {
        Ok(())
    }
}
