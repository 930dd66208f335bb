//! The inputs of a merged level: a cut through the tree below its node.

use glam::{DVec3, Vec3};

use super::levels::{Level, LeveledMesh};
use super::linear::WorldBox;
use super::placed::Leaf;
use super::tree::TreeNode;
use crate::lists::at;
use trimaran_scene::{Rgba8, Vertex};

/// An interior node's frame, bounds and levels.
#[derive(Debug)]
pub(super) struct Merged {
    /// The origin of the node's frame: the centre of the items' box.
    pub(super) origin: DVec3,
    /// Contains the node's levels and all below it.
    pub(super) bounds: WorldBox,
    /// Finest first; none if merging saved too little.
    pub(super) levels: Vec<MergedLevel>,
}

/// A merged level in its node's frame.
#[derive(Debug)]
pub(super) struct MergedLevel {
    pub(super) vertices: Vec<Vertex>,
    pub(super) indices: Vec<u32>,
    pub(super) error: f32,
}

/// The inputs for merging a node: the leaves, and the nodes below it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Below<'a> {
    pub(super) tree: &'a [TreeNode],
    pub(super) leaves: &'a [Leaf],
    pub(super) meshes: &'a [Option<LeveledMesh>],
    pub(super) merged: &'a [Option<Merged>],
}

/// Triangles gathered in a node's frame.
#[derive(Debug, Default)]
pub(super) struct Soup {
    pub(super) positions: Vec<Vec3>,
    pub(super) colours: Vec<Rgba8>,
    pub(super) indices: Vec<u32>,
    /// The largest error of the gathered levels.
    pub(super) error: f32,
}

/// One level of a node.
#[derive(Debug, Clone, Copy)]
enum Chosen<'a> {
    /// Of an object.
    Object { leaf: &'a Leaf, mesh: &'a LeveledMesh, level: &'a Level },
    /// Of a node that has been merged.
    Merged { origin: DVec3, level: &'a MergedLevel },
}

impl<'a> Below<'a> {
    /// Gathers the levels below a node, in a frame about `origin`: of each object or merged node the coarsest
    /// with an error of at most `error`, or else the finest. `None` if that makes more than `most` triangles.
    pub(super) fn gather(&self, node: &TreeNode, origin: DVec3, error: f64, most: usize) -> Option<Soup> {
        let mut chosen = Vec::new();
        let mut triangles = 0;
        for child in node.children.clone() {
            self.visit(child, error, &mut |level| {
                triangles += level.triangles();
                chosen.push(level);
                triangles <= most
            })?;
        }
        let mut soup = Soup::default();
        chosen.iter().for_each(|level| soup.add(level, origin));
        Some(soup)
    }

    /// The number of triangles below a node at the coarsest levels.
    pub(super) fn fewest(&self, node: &TreeNode) -> usize {
        let mut triangles = 0;
        for child in node.children.clone() {
            // Never stops on its own.
            let _: Option<()> = self.visit(child, f64::INFINITY, &mut |level| {
                triangles += level.triangles();
                true
            });
        }
        triangles
    }

    /// Descends from a node to the levels of the cut, until `add` stops it: then `None`.
    fn visit(&self, index: u32, error: f64, add: &mut dyn FnMut(Chosen<'a>) -> bool) -> Option<()> {
        let Some(node) = self.tree.get(index as usize) else { return Some(()) };
        if let Some(leaf) = node.item.and_then(|item| self.leaves.get(item as usize)) {
            let Some(mesh) = self.meshes.get(leaf.mesh as usize).and_then(Option::as_ref) else {
                return Some(());
            };
            let good = |level: &&Level| f64::from(leaf.world_error(level.error)) <= error;
            let Some(level) = mesh.levels.iter().rev().find(good).or(mesh.levels.first()) else {
                return Some(());
            };
            return add(Chosen::Object { leaf, mesh, level }).then_some(());
        }
        let merged = self.merged.get(index as usize).and_then(Option::as_ref);
        let good = |level: &&MergedLevel| f64::from(level.error) <= error;
        match merged.and_then(|merged| Some((merged.origin, merged.levels.iter().rev().find(good)?))) {
            Some((origin, level)) => add(Chosen::Merged { origin, level }).then_some(()),
            None => node.children.clone().try_for_each(|child| self.visit(child, error, add)),
        }
    }
}

impl Chosen<'_> {
    fn triangles(&self) -> usize {
        match self {
            Self::Object { level, .. } => level.indices.len() / 3,
            Self::Merged { level, .. } => level.indices.len() / 3,
        }
    }
}

impl Soup {
    pub(super) fn triangles(&self) -> &[[u32; 3]] {
        self.indices.as_chunks().0
    }

    /// The corners of a triangle.
    pub(super) fn triangle(&self, index: u32) -> [u32; 3] {
        self.triangles().get(index as usize).copied().unwrap_or_default()
    }

    pub(super) fn position(&self, corner: u32) -> Vec3 {
        at(&self.positions, corner)
    }

    pub(super) fn colour(&self, corner: u32) -> Rgba8 {
        self.colours.get(corner as usize).copied().unwrap_or(Rgba8([255; 4]))
    }

    fn add(&mut self, level: &Chosen<'_>, origin: DVec3) {
        match *level {
            Chosen::Object { leaf, mesh, level } => {
                let vertices = mesh.vertices.iter().take(level.vertex_count as usize);
                let placed = vertices.map(|v| (leaf.to_world(v) - origin, v.colour));
                self.append(placed, &level.indices, leaf.world_error(level.error));
            }
            Chosen::Merged { origin: from, level } => {
                let shift = from - origin;
                let place = |v: &Vertex| (Vec3::from_array(v.position).as_dvec3() + shift, v.colour);
                self.append(level.vertices.iter().map(place), &level.indices, level.error);
            }
        }
    }

    fn append(&mut self, vertices: impl Iterator<Item = (DVec3, Rgba8)>, indices: &[u32], error: f32) {
        let first = self.positions.len() as u32;
        for (position, colour) in vertices {
            self.positions.push(position.as_vec3());
            self.colours.push(colour);
        }
        self.indices.extend(indices.iter().map(|&index| first + index));
        self.error = self.error.max(error);
    }
}
