//! Merged levels for interior nodes: what stands below, drawn as one small mesh.
//!
//! A node's merged level is made from the coarsest levels below it, put into the node's frame, welded and simplified. Its
//! error is bounded by the triangle inequality: the largest error of what was merged, plus the measured distance from that
//! to the result. A part that the simplifier drops is seen by the measurement: the distance from the part to what is left
//! counts, so a level's error is never below the size of what vanished.

use glam::{DVec3, Vec3};
use meshopt::{SimplifyOptions, VertexDataAdapter};
use rayon::prelude::*;

use super::hausdorff::{self, Surface};
use super::levels::LeveledMesh;
use super::linear::WorldBox;
use super::placed::{Leaf, round_up};
use super::tree::TreeNode;
use super::{CookOptions, Phase, Progress};
use crate::{Rgba8, Vertex};

/// A merged level is kept if it has at most this part of the triangles it stands for.
const WORTH: f32 = 0.7;
/// A merged level aims at this part of the triangles it stands for.
const AIM: usize = 4;
/// ... but not below this many.
const FEW: usize = 256;
/// The simplifier stops where its own estimate of the error passes this part of the node's diagonal, even if that leaves more
/// triangles than aimed at: a level that is far from what it stands for is never drawn.
const COARSEST: f32 = 0.03;
/// Vertices closer than this part of the node's diagonal are welded.
const WELD: f64 = 1e-4;
/// Rounding of positions to single precision about the node's origin, as part of the node's diagonal: 2^-24 for each axis.
const ROUNDING: f64 = 1.1e-7;

/// An interior node's frame, bounds and level.
#[derive(Debug)]
pub(super) struct Merged {
    /// The origin of the node's frame: the centre of the items' box.
    pub(super) origin: DVec3,
    /// Holds the node's level and all below it.
    pub(super) bounds: WorldBox,
    /// `None` where merging saved too little.
    pub(super) level: Option<MergedLevel>,
}

/// A merged level in its node's frame.
#[derive(Debug)]
pub(super) struct MergedLevel {
    pub(super) vertices: Vec<Vertex>,
    pub(super) indices: Vec<u32>,
    pub(super) error: f32,
}

/// Merges levels for all interior nodes, from the leaves up. One entry a node of the tree; `None` for leaves.
pub(super) fn merge_all(
    tree: &[TreeNode],
    leaves: &[Leaf],
    meshes: &[Option<LeveledMesh>],
    options: &CookOptions,
    progress: &dyn Progress,
) -> Vec<Option<Merged>> {
    let generations = by_height(tree);
    progress.begin(Phase::Merging, generations.iter().map(Vec::len).sum());
    let mut merged: Vec<Option<Merged>> = tree.iter().map(|_| None).collect();
    for generation in generations {
        let below = Below { tree, leaves, meshes, merged: &merged };
        let made: Vec<(u32, Option<Merged>)> = generation
            .into_par_iter()
            .with_max_len(8)
            .map(|index| {
                let node = below.merge(index, options.merged_triangles);
                progress.advance(1);
                (index, node)
            })
            .collect();
        for (index, node) in made {
            if let Some(slot) = merged.get_mut(index as usize) {
                *slot = node;
            }
        }
    }
    merged
}

/// The interior nodes, grouped by the longest way down to a leaf: a group needs only the groups before it.
fn by_height(tree: &[TreeNode]) -> Vec<Vec<u32>> {
    let mut heights = vec![0_usize; tree.len()];
    let mut groups: Vec<Vec<u32>> = Vec::new();
    for (index, node) in tree.iter().enumerate().rev() {
        let tallest = node.children.clone().filter_map(|c| heights.get(c as usize)).max();
        let Some(height) = tallest.map(|tallest| tallest + 1) else { continue };
        if let Some(slot) = heights.get_mut(index) {
            *slot = height;
        }
        if groups.len() < height {
            groups.resize_with(height, Vec::new);
        }
        if let Some(group) = groups.get_mut(height - 1) {
            group.push(index as u32);
        }
    }
    groups
}

/// All that is known when a node is merged: the leaves, and the nodes below it.
#[derive(Debug, Clone, Copy)]
struct Below<'a> {
    tree: &'a [TreeNode],
    leaves: &'a [Leaf],
    meshes: &'a [Option<LeveledMesh>],
    merged: &'a [Option<Merged>],
}

/// Triangles gathered in a node's frame.
#[derive(Debug, Default)]
struct Soup {
    positions: Vec<Vec3>,
    colours: Vec<Rgba8>,
    indices: Vec<u32>,
    /// The largest error of the levels gathered.
    error: f32,
}

impl Below<'_> {
    /// Merges the children of a node; `None` for a leaf.
    fn merge(&self, index: u32, most: usize) -> Option<Merged> {
        let node = self.tree.get(index as usize)?;
        if node.item.is_some() {
            return None;
        }
        let origin = node.bounds.centre();
        let mut soup = Soup::default();
        let mut bounds = node.bounds;
        for child in node.children.clone() {
            self.gather(child, origin, &mut soup);
            if let Some(Some(child)) = self.merged.get(child as usize) {
                bounds = bounds.union(child.bounds);
            }
        }
        let level = soup.merge(bounds.diagonal(), most);
        for vertex in level.iter().flat_map(|level| &level.vertices) {
            bounds = bounds.including(origin + Vec3::from_array(vertex.position).as_dvec3());
        }
        Some(Merged { origin, bounds: bounds.padded(), level })
    }

    /// Adds the coarsest level of a node, or of all below it where it has none.
    fn gather(&self, index: u32, origin: DVec3, soup: &mut Soup) {
        let Some(node) = self.tree.get(index as usize) else { return };
        if let Some(leaf) = node.item.and_then(|item| self.leaves.get(item as usize)) {
            let mesh = self.meshes.get(leaf.mesh as usize).and_then(Option::as_ref);
            if let Some((mesh, level)) = mesh.and_then(|mesh| Some((mesh, mesh.levels.last()?))) {
                let vertices = mesh.vertices.iter().take(level.vertex_count as usize);
                let placed = vertices.map(|v| (leaf.to_world(v) - origin, v.colour));
                soup.add(placed, &level.indices, leaf.world_error(level.error));
            }
            return;
        }
        match self.merged.get(index as usize).and_then(Option::as_ref) {
            Some(Merged { origin: from, level: Some(level), .. }) => {
                let shift = *from - origin;
                let placed = level
                    .vertices
                    .iter()
                    .map(|v| (Vec3::from_array(v.position).as_dvec3() + shift, v.colour));
                soup.add(placed, &level.indices, level.error);
            }
            _ => node.children.clone().for_each(|child| self.gather(child, origin, soup)),
        }
    }
}

impl Soup {
    fn add(&mut self, vertices: impl Iterator<Item = (DVec3, Rgba8)>, indices: &[u32], error: f32) {
        let first = self.positions.len() as u32;
        for (position, colour) in vertices {
            self.positions.push(position.as_vec3());
            self.colours.push(colour);
        }
        self.indices.extend(indices.iter().map(|&index| first + index));
        self.error = self.error.max(error);
    }

    /// Simplifies the soup towards `most` triangles or fewer; `None` if that saves too little.
    fn merge(&self, diagonal: f64, most: usize) -> Option<MergedLevel> {
        let before = self.indices.len() / 3;
        let aim = (before / AIM).max(FEW).min(most);
        if aim as f32 > WORTH * before as f32 {
            return None; // the nodes above gather these triangles themselves
        }
        let (vertices, indices) = self.weld(diagonal * WELD);
        let goal = (3 * aim).min(indices.len()); // the simplifier aborts on more
        let positions: Vec<Vec3> = vertices.iter().map(|v| Vec3::from_array(v.position)).collect();
        let adapter = VertexDataAdapter::new(bytemuck::cast_slice(&positions), size_of::<Vec3>(), 0).ok()?;
        let options = SimplifyOptions::Prune | SimplifyOptions::Permissive | SimplifyOptions::ErrorAbsolute;
        let indices = meshopt::simplify(&indices, &adapter, goal, COARSEST * diagonal as f32, options, None);
        let after = indices.len() / 3;
        if after == 0 || after as f32 > WORTH * before as f32 {
            return None;
        }
        let measured = hausdorff::bound(
            &Surface::new(&self.positions, &self.indices),
            &Surface::new(&positions, &indices),
        );
        let error = round_up(f64::from(self.error) + f64::from(measured) + ROUNDING * diagonal);
        let (vertices, indices) = compact(&vertices, indices);
        error.is_finite().then_some(MergedLevel { vertices, indices, error })
    }

    /// Makes one vertex of those of one colour in the same cell of a grid, and drops the triangles that collapse.
    fn weld(&self, cell: f64) -> (Vec<Vertex>, Vec<u32>) {
        let scale = if cell > 0.0 { (1.0 / cell) as f32 } else { 1.0 };
        let keys: Vec<[u32; 4]> = self
            .positions
            .iter()
            .zip(&self.colours)
            .map(|(p, colour)| {
                let cell = (*p * scale).round().as_ivec3();
                [cell.x as u32, cell.y as u32, cell.z as u32, u32::from_le_bytes(colour.0)]
            })
            .collect();
        let (count, remap) = meshopt::generate_vertex_remap(&keys, None);
        let mut vertices: Vec<Option<Vertex>> = vec![None; count];
        for ((position, &colour), &slot) in self.positions.iter().zip(&self.colours).zip(&remap) {
            if let Some(slot @ None) = vertices.get_mut(slot as usize) {
                *slot = Some(Vertex::new(position.to_array(), colour));
            }
        }
        let mut indices = self.indices.clone();
        for index in &mut indices {
            *index = remap.get(*index as usize).copied().unwrap_or_default();
        }
        let (triangles, _) = indices.as_chunks::<3>();
        let whole =
            triangles.iter().filter(|[a, b, c]| a != b && b != c && c != a).flatten().copied().collect();
        (vertices.into_iter().flatten().collect(), whole)
    }
}

/// Keeps the vertices that are used, in the order of use.
fn compact(vertices: &[Vertex], mut indices: Vec<u32>) -> (Vec<Vertex>, Vec<u32>) {
    meshopt::optimize_vertex_cache_in_place(&mut indices, vertices.len());
    let mut place = vec![u32::MAX; vertices.len()];
    let mut used = Vec::new();
    for index in &mut indices {
        if let (Some(slot), Some(vertex)) = (place.get_mut(*index as usize), vertices.get(*index as usize)) {
            if *slot == u32::MAX {
                *slot = used.len() as u32;
                used.push(*vertex);
            }
            *index = *slot;
        }
    }
    (used, indices)
}
