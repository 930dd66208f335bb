//! Merged levels for interior nodes: everything below, drawn as one small mesh.
//!
//! A node's merged levels are made from finer levels below it, gathered in the node's frame. A surface
//! simplifier can only thin many small disjoint parts by dropping some, and dropped parts are far from the
//! rest. So their corners are clustered (`thin`), which also bounds the error of the result.
//!
//! A level's error is bounded by the triangle inequality: the largest error of the gathered levels, plus the
//! distance from these to the result.

use glam::Vec3;
use rayon::prelude::*;

use super::gather::{Below, Merged, MergedLevel};
use super::levels::LeveledMesh;
use super::placed::{Leaf, round_up};
use super::thin::thin;
use super::tree::{self, TreeNode};
use super::{CookOptions, Phase, Progress};
use crate::lists::put;

/// A merged level is kept if it has at most this fraction of the fewest triangles without it.
const WORTH: f64 = 0.7;
/// Nodes over fewer triangles than this, all of objects, are not merged.
const FEW: usize = 512;
/// The target distance of the finest merged level from the gathered ones, relative to the node's diagonal.
/// Triangles grow with the square of its inverse.
const NEAR: f64 = 0.035;
/// The ratio of the distances of successive levels, and of attempts when a level would save too little.
const STEP: f64 = 1.5;
/// ... and this many distances are tried.
const TRIES: i32 = 4;
/// The most levels of a node. With one level each, the cut would be up to a whole height of the tree too
/// fine: on average twice the triangles.
const LEVELS: usize = 2;
/// The error of the gathered levels, relative to the finest level's distance. It adds to the levels' own.
const FINE: f64 = 0.3;
/// The most triangles gathered, relative to the target: beyond it, coarser levels are gathered.
const GATHERED: usize = 16;
/// Rounding of positions to single precision about the node's origin, relative to the node's diagonal: 2^-24
/// for each axis.
const ROUNDING: f64 = 1.1e-7;

/// Merges levels for all interior nodes, from the leaves up. One entry a node of the tree; `None` for leaves.
pub(super) fn merge_all(
    tree: &[TreeNode],
    leaves: &[Leaf],
    meshes: &[Option<LeveledMesh>],
    options: &CookOptions,
    progress: &dyn Progress,
) -> Vec<Option<Merged>> {
    let generations = tree::by_height(tree);
    progress.begin(Phase::Merging, generations.iter().map(Vec::len).sum());
    let mut merged: Vec<Option<Merged>> = tree.iter().map(|_| None).collect();
    for generation in generations {
        let below = Below { tree, leaves, meshes, merged: &merged };
        let made: Vec<(u32, Option<Merged>)> = generation
            .into_par_iter()
            .with_max_len(8)
            .map(|index| {
                let node = merge(below, index, options.merged_triangles);
                progress.advance(1);
                (index, node)
            })
            .collect();
        for (index, node) in made {
            put(&mut merged, index, node);
        }
    }
    merged
}

/// Merges the children of a node; `None` for a leaf.
fn merge(below: Below<'_>, index: u32, most: usize) -> Option<Merged> {
    let node = below.tree.get(index as usize)?;
    if node.item.is_some() {
        return None;
    }
    let origin = node.bounds.centre();
    let merged = node.children.clone().filter_map(|child| below.merged.get(child as usize)?.as_ref());
    let mut bounds = merged.fold(node.bounds, |bounds, child| bounds.union(child.bounds));
    let levels = merge_levels(below, node, bounds.diagonal(), most);
    for vertex in levels.iter().flat_map(|level| &level.vertices) {
        bounds = bounds.including(origin + Vec3::from_array(vertex.position).as_dvec3());
    }
    Some(Merged { origin, bounds: bounds.padded(), levels })
}

/// Levels of at most `most` triangles for a node of this diagonal, finest first; none if they would save too
/// little.
fn merge_levels(below: Below<'_>, node: &TreeNode, diagonal: f64, most: usize) -> Vec<MergedLevel> {
    let fewest = below.fewest(node);
    let has_levels = |child: u32| matches!(below.merged.get(child as usize), Some(Some(merged)) if !merged.levels.is_empty());
    if fewest < FEW && !node.children.clone().any(has_levels) {
        return Vec::new(); // the nodes above gather these triangles themselves
    }
    let near = |step: i32| NEAR * diagonal * STEP.powi(step);
    let gather = |error, most| below.gather(node, node.bounds.centre(), error, most);
    // Even the coarsest levels may be more triangles than wanted; nothing coarser exists then.
    let soup = (0..2 * TRIES)
        .find_map(|step| gather(FINE * near(step), GATHERED * most))
        .or_else(|| gather(f64::INFINITY, usize::MAX));
    let mut enough = most.min((WORTH * fewest as f64) as usize);
    let mut levels = Vec::new();
    for (soup, step) in soup.iter().flat_map(|soup| (0..TRIES).map(move |step| (soup, step))) {
        if levels.len() == LEVELS {
            break;
        }
        let Some(thinned) = thin(soup, near(step) as f32, enough) else { continue };
        let error = f64::from(thinned.error) + f64::from(soup.error);
        let error = round_up(error + ROUNDING * diagonal);
        if thinned.count() > 0 && error.is_finite() {
            enough = (WORTH * thinned.count() as f64) as usize;
            let (vertices, indices) = thinned.into_mesh();
            levels.push(MergedLevel { vertices, indices, error });
        }
    }
    levels
}
