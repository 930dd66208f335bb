//! The tree: nodes, their boxes, their levels, and errors that never fall towards the root.

use rayon::prelude::*;

use super::super::{Drawable, Node, Parts};
use super::{Check, SceneError, malformed};

/// Nodes that a thread checks at a time.
const RUN: usize = 4096;

/// What a run of nodes hands on to the rules that no run can check alone.
#[derive(Default)]
struct Run {
    /// The first of its nodes with children, and its first child.
    first_parent: Option<(usize, u32)>,
    /// The end of the children of its last node with children.
    children_end: Option<u32>,
    /// How many drawables its nodes have.
    drawables: usize,
    /// The errors of those of its nodes that another node's can contradict.
    errors: Vec<Errors>,
}

/// The errors of a node's levels.
struct Errors {
    node: usize,
    parent: usize,
    /// Of the finest level and of the coarsest, if it has levels.
    range: Option<(f32, f32)>,
}

/// Breadth-first order: the children of node 0, then those of node 1, and so on, without a gap; each knows
/// its parent. Each drawable belongs to exactly one node; leaves have a level and an object. Errors never
/// fall towards the root.
pub(super) fn check(parts: &Parts<'_>) -> Result<(), SceneError> {
    let runs: Vec<Result<Run, SceneError>> = parts
        .nodes
        .par_chunks(RUN)
        .enumerate()
        .map(|(run, nodes)| check_run(parts, run * RUN, nodes))
        .collect();
    let mut next_child = 1;
    let mut drawables = 0;
    let mut limits = vec![0.0; parts.nodes.len()];
    for run in runs {
        let run = run?;
        if let Some((node, first_child)) = run.first_parent {
            check_next(first_child, next_child).map_err(malformed("node", node))?;
        }
        next_child = run.children_end.unwrap_or(next_child);
        drawables += run.drawables;
        check_errors(parts, &run.errors, &mut limits)?;
    }
    // No drawable is counted twice, since each names its one node.
    if drawables < parts.drawables.len() {
        let orphan = parts.drawables.iter().enumerate().position(|(index, drawable)| {
            let node = parts.nodes.get(drawable.node as usize);
            !node.is_some_and(|node| levels(node).contains(&index))
        });
        let why = "its node does not have it among its levels";
        return Err(malformed("drawable", orphan.unwrap_or(drawables))(why));
    }
    Ok(())
}

fn levels(node: &Node) -> std::ops::Range<usize> {
    let first = node.first_drawable as usize;
    first..first.saturating_add(node.drawable_count as usize)
}

/// Checks nodes that follow each other, the first of which has index `start`.
fn check_run(parts: &Parts<'_>, start: usize, nodes: &[Node]) -> Result<Run, SceneError> {
    let mut run = Run { children_end: (start == 0).then_some(1), ..Run::default() };
    for (index, node) in (start..).zip(nodes) {
        if !node.is_leaf() {
            match run.children_end {
                Some(next) => check_next(node.first_child, next).map_err(malformed("node", index))?,
                None => run.first_parent = Some((index, node.first_child)),
            }
            run.children_end = Some(node.first_child.saturating_add(node.child_count));
        }
        check_place(parts.nodes, index, node).map_err(malformed("node", index))?;
        check_boxes(node).map_err(malformed("node", index))?;
        let drawables = check_levels(parts, node).map_err(malformed("node", index))?;
        for (level, drawable) in levels(node).zip(drawables) {
            check_drawable(parts, index, drawable).map_err(malformed("drawable", level))?;
        }
        for ((level, finer), coarser) in levels(node).skip(1).zip(drawables).zip(drawables.iter().skip(1)) {
            check_coarser(coarser.error, finer.error).map_err(malformed("drawable", level))?;
        }
        run.drawables += drawables.len();
        let range = drawables.first().zip(drawables.last()).map(|(fine, coarse)| (fine.error, coarse.error));
        // A leaf without an error, as most are, is below every limit and is none.
        if !node.is_leaf() || range.is_some_and(|(_, coarsest)| coarsest > 0.0) {
            run.errors.push(Errors { node: index, parent: node.parent as usize, range });
        }
    }
    Ok(run)
}

fn check_next(first_child: u32, expected: u32) -> Check {
    let why = "its children are not next in breadth-first order";
    if first_child == expected { Ok(()) } else { Err(why) }
}

/// Whether a node and its parent agree, and its children are in range.
fn check_place(nodes: &[Node], index: usize, node: &Node) -> Check {
    if !node.is_leaf() {
        if node.first_child as usize <= index {
            return Err("its children are not next in breadth-first order");
        }
        let end = node.first_child.checked_add(node.child_count);
        if end.is_none_or(|end| end as usize > nodes.len()) {
            return Err("its children lie past the last node");
        }
    }
    if index == 0 {
        return if node.parent == Node::NONE { Ok(()) } else { Err("it is the root but has a parent") };
    }
    // That a parent stands before its children is checked at the parent.
    let parent = nodes.get(node.parent as usize).filter(|parent| {
        let children = parent.first_child..parent.first_child.saturating_add(parent.child_count);
        children.contains(&(index as u32))
    });
    match parent {
        None => Err("its parent is not the node whose child it is"),
        Some(parent) if parent.object != Node::NONE && node.object != parent.object => {
            Err("it is not of the object whose part it is")
        }
        Some(parent) if !contains(parent, node) => Err("its box sticks out of its parent's"),
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
    } else {
        Ok(())
    }
}

/// Whether a node has the levels and the object it should have; returns the levels.
fn check_levels<'a>(parts: &Parts<'a>, node: &Node) -> Result<&'a [Drawable], &'static str> {
    let drawables = parts.drawables.get(levels(node)).ok_or("its levels lie past the last drawable")?;
    let has_object = (node.object as usize) < parts.objects.len();
    match drawables {
        [] if node.is_leaf() => Err("it is a leaf without a drawable"),
        [finest, ..] if node.is_leaf() && finest.error != 0.0 => {
            Err("it is a leaf whose finest level has an error")
        }
        _ if node.is_leaf() && !has_object => Err("it is a leaf whose object does not exist"),
        _ if node.object != Node::NONE && !has_object => Err("its object does not exist"),
        _ if node.object == Node::NONE && node.linear != [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] => {
            Err("it stands for several objects, but its matrix is not the identity")
        }
        drawables => Ok(drawables),
    }
}

fn check_drawable(parts: &Parts<'_>, node: usize, drawable: &Drawable) -> Check {
    let fits = |first: u32, count: u32, len: usize| u64::from(first) + u64::from(count) <= len as u64;
    if drawable.node as usize != node {
        Err("its node does not have it among its levels")
    } else if !(drawable.error.is_finite() && drawable.error >= 0.0) {
        Err("its error is no distance")
    } else if drawable.index_count == 0 || !drawable.index_count.is_multiple_of(3) {
        Err("its number of indices is not a multiple of three above zero")
    } else if !fits(drawable.first_index, drawable.index_count, parts.indices.len()) {
        Err("its indices lie past the last one")
    } else if !fits(drawable.vertex_offset, drawable.vertex_count, parts.vertices.len()) {
        Err("its vertices lie past the last one")
    } else if !drawable.sides.is_known() {
        Err("which sides of its triangles show is neither 0 nor 1")
    } else {
        Ok(())
    }
}

fn check_coarser(coarser: f32, finer: f32) -> Check {
    let why = "its error is below that of a finer level, or of a node below its own";
    if coarser < finer { Err(why) } else { Ok(()) }
}

/// Errors never fall from a node to those above it. Parents come before their children, so `limits` has, for
/// each node above, the error that nothing below it may exceed: its finest level's, or if it has none, that
/// of the node above it.
fn check_errors(parts: &Parts<'_>, errors: &[Errors], limits: &mut [f32]) -> Result<(), SceneError> {
    for &Errors { node, parent, range } in errors {
        let above = limits.get(parent).copied().unwrap_or(f32::INFINITY); // the root has no parent
        if let Some((_, coarsest)) = range
            && above < coarsest
        {
            let ancestor = with_levels_above(parts.nodes, parent);
            check_coarser(above, coarsest).map_err(malformed("drawable", ancestor))?;
        }
        if let Some(limit) = limits.get_mut(node) {
            *limit = range.map_or(above, |(finest, _)| finest);
        }
    }
    Ok(())
}

/// The finest level of the first node with levels, from `node` upwards.
fn with_levels_above(nodes: &[Node], node: usize) -> usize {
    let chain = std::iter::successors(nodes.get(node), |node| nodes.get(node.parent as usize));
    chain.into_iter().find(|node| node.drawable_count > 0).map_or(0, |node| node.first_drawable as usize)
}
