//! What makes arrays a scene. Everything later code relies on without looking is checked here, once.

use rayon::prelude::*;
use thiserror::Error;

use super::{Drawable, Node, ObjectRecord, Parts};

/// Why arrays are not a scene.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A record refers to something that is not there, or breaks the order the format promises.
    #[error("{what} {index} is malformed: {why}")]
    Malformed {
        /// The kind of record.
        what: &'static str,
        /// Its index.
        index: usize,
        /// What is wrong.
        why: &'static str,
    },
    /// The scene has no nodes.
    #[error("the scene has no nodes: there is nothing to draw")]
    Empty,
    /// More records of one kind than a `u32` can number.
    #[error("{count} {what} are more than a scene can number (2^32 - 2)")]
    TooMany {
        /// The kind of record.
        what: &'static str,
        /// How many there are.
        count: usize,
    },
}

type Check = Result<(), &'static str>;

/// Checks all rules of the format.
pub(super) fn check(parts: &Parts<'_>) -> Result<(), SceneError> {
    if parts.nodes.is_empty() {
        return Err(SceneError::Empty);
    }
    check_counts(parts)?;
    check_tree(parts)?;
    each("node", parts.nodes, check_boxes)?;
    check_levels(parts)?;
    check_errors(parts)?;
    each("drawable", parts.drawables, |drawable| check_ranges(parts, drawable))?;
    check_indices(parts)?;
    each("vertex", parts.vertices, |vertex| {
        vertex.position.iter().all(|c| c.is_finite()).then_some(()).ok_or("its position is not finite")
    })?;
    each("object", parts.objects, |object| check_object(parts, object))
}

/// Runs `rule` over all records in parallel; the error is the first record's by index, whatever the threads do.
fn each<T: Sync>(
    what: &'static str,
    records: &[T],
    rule: impl Fn(&T) -> Check + Sync,
) -> Result<(), SceneError> {
    let broken = records
        .par_iter()
        .enumerate()
        .with_min_len(4096)
        .find_map_first(|(index, record)| rule(record).err().map(|why| (index, why)));
    broken.map_or(Ok(()), |(index, why)| Err(SceneError::Malformed { what, index, why }))
}

fn check_counts(parts: &Parts<'_>) -> Result<(), SceneError> {
    let counts = [
        ("nodes", parts.nodes.len()),
        ("drawables", parts.drawables.len()),
        ("vertices", parts.vertices.len()),
        ("indices", parts.indices.len()),
        ("objects", parts.objects.len()),
        ("bytes of names", parts.names.len()),
    ];
    match counts.into_iter().find(|&(_, count)| count >= u32::MAX as usize) {
        Some((what, count)) => Err(SceneError::TooMany { what, count }),
        None => Ok(()),
    }
}

/// Breadth-first order: the children of node 0, then those of node 1, and so on, without a gap; each knows its parent.
fn check_tree(parts: &Parts<'_>) -> Result<(), SceneError> {
    let nodes = parts.nodes;
    let broken = |index, why| SceneError::Malformed { what: "node", index, why };
    let mut next = 1_usize;
    for (index, node) in nodes.iter().enumerate() {
        if index == 0 && node.parent != Node::NONE {
            return Err(broken(index, "it is the root but has a parent"));
        }
        if node.is_leaf() {
            continue;
        }
        let end = next + node.child_count as usize;
        if node.first_child as usize != next || next <= index {
            return Err(broken(index, "its children are not next in breadth-first order"));
        }
        let Some(children) = nodes.get(next..end) else {
            return Err(broken(index, "its children lie past the last node"));
        };
        for (child, record) in (next..end).zip(children) {
            if record.parent as usize != index {
                return Err(broken(child, "its parent is not the node whose child it is"));
            }
            if node.object != Node::NONE && record.object != node.object {
                return Err(broken(child, "it is not of the object whose part it is"));
            }
            if !contains(node, record) {
                return Err(broken(child, "its box sticks out of its parent's"));
            }
        }
        next = end;
    }
    if next < nodes.len() { Err(broken(next, "it is no node's child")) } else { Ok(()) }
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

/// Each drawable belongs to exactly one node; leaves have a level and an object.
fn check_levels(parts: &Parts<'_>) -> Result<(), SceneError> {
    each("node", parts.nodes, |node| {
        let first = node.first_drawable as usize;
        let levels =
            first.checked_add(node.drawable_count as usize).and_then(|end| parts.drawables.get(first..end));
        match levels {
            None => Err("its levels lie past the last drawable"),
            Some([]) if node.is_leaf() => Err("it is a leaf without a drawable"),
            Some([finest, ..]) if node.is_leaf() && finest.error != 0.0 => {
                Err("it is a leaf whose finest level has an error")
            }
            Some(_) if node.is_leaf() && node.object as usize >= parts.objects.len() => {
                Err("it is a leaf whose object does not exist")
            }
            Some(_) if node.object != Node::NONE && node.object as usize >= parts.objects.len() => {
                Err("its object does not exist")
            }
            Some(_)
                if node.object == Node::NONE
                    && node.linear != [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] =>
            {
                Err("it stands for several objects, but its matrix is not the identity")
            }
            Some(_) => Ok(()),
        }
    })?;
    let mut owner = vec![Node::NONE; parts.drawables.len()];
    for (index, node) in (0_u32..).zip(parts.nodes) {
        let first = node.first_drawable as usize;
        for slot in owner.iter_mut().skip(first).take(node.drawable_count as usize) {
            *slot = index;
        }
    }
    let claimed: Vec<(&Drawable, u32)> = parts.drawables.iter().zip(owner).collect();
    each("drawable", &claimed, |&(drawable, owner)| {
        if drawable.node == owner { Ok(()) } else { Err("its node does not have it among its levels") }
    })
}

/// Errors are finite and never fall, from level to coarser level and from node to parent.
fn check_errors(parts: &Parts<'_>) -> Result<(), SceneError> {
    each("drawable", parts.drawables, |drawable| {
        if drawable.error.is_finite() && drawable.error >= 0.0 {
            Ok(())
        } else {
            Err("its error is no distance")
        }
    })?;
    // The coarsest error at or below each node: children follow their parents, so one backward pass finds it.
    let mut below = vec![0.0_f32; parts.nodes.len()];
    for (index, node) in parts.nodes.iter().enumerate().rev() {
        let mut coarsest =
            node.children().filter_map(|c| below.get(c as usize)).fold(0.0, |a: f32, &b| a.max(b));
        let first = node.first_drawable as usize;
        for (level, drawable) in
            (first..).zip(parts.drawables.iter().skip(first).take(node.drawable_count as usize))
        {
            if drawable.error < coarsest {
                let why = "its error is below that of a finer level, or of a node below its own";
                return Err(SceneError::Malformed { what: "drawable", index: level, why });
            }
            coarsest = drawable.error;
        }
        if let Some(slot) = below.get_mut(index) {
            *slot = coarsest;
        }
    }
    Ok(())
}

fn check_ranges(parts: &Parts<'_>, drawable: &Drawable) -> Check {
    let fits = |first: u32, count: u32, len: usize| u64::from(first) + u64::from(count) <= len as u64;
    if drawable.index_count == 0 || !drawable.index_count.is_multiple_of(3) {
        Err("its number of indices is not a multiple of three above zero")
    } else if !fits(drawable.first_index, drawable.index_count, parts.indices.len()) {
        Err("its indices lie past the last one")
    } else if !fits(drawable.vertex_offset, drawable.vertex_count, parts.vertices.len()) {
        Err("its vertices lie past the last one")
    } else {
        Ok(())
    }
}

/// Every index stays within its drawable's vertices. Instances share ranges, so each distinct range is read once.
fn check_indices(parts: &Parts<'_>) -> Result<(), SceneError> {
    let mut ranges: Vec<(u32, u32, u32, u32)> = (0_u32..)
        .zip(parts.drawables)
        .map(|(index, d)| (d.first_index, d.index_count, d.vertex_count, index))
        .collect();
    ranges.par_sort_unstable();
    ranges.dedup_by_key(|range| (range.0, range.1, range.2));
    let broken = ranges
        .par_iter()
        .filter(|&&(first, count, vertices, _)| {
            let indices = parts.indices.iter().skip(first as usize).take(count as usize);
            indices.fold(0, |largest: u32, &i| largest.max(i)) >= vertices
        })
        .map(|range| range.3)
        .min();
    match broken {
        Some(index) => Err(SceneError::Malformed {
            what: "drawable",
            index: index as usize,
            why: "one of its indices points past its vertices",
        }),
        None => Ok(()),
    }
}

fn check_object(parts: &Parts<'_>, object: &ObjectRecord) -> Check {
    if object.source as usize >= parts.sources.len() {
        Err("its source file does not exist")
    } else if parts.name_of(object).is_none() {
        Err("its name is not a range of whole characters of the names")
    } else {
        Ok(())
    }
}
