//! A frame's drawables under one tree, for the first hits of rays.

use std::sync::Arc;

use glam::{Mat3A, Vec3A, Vec4};
use obvhs::aabb::Aabb;
use rayon::prelude::*;
use trimaran_cull::{Facing, Solids, View};
use trimaran_proto::DrawableId;
use trimaran_scene::{Node, Scene};

use super::{
    mesh::{LARGEST, Mesh, Meshes, Shape},
    packet::Packet,
    pixels::PixelRays,
    tree::Tree,
};

/// The solid drawables of a frame, prepared for rays from its eye.
#[derive(Default)]
pub(crate) struct Placed {
    tree: Tree,
    /// In the tree's order.
    instances: Vec<Instance>,
    /// Undecidable ones, with a coordinate that is too large.
    undecided: Vec<u32>,
}

/// A drawable, prepared for rays from the eye.
#[derive(Clone)]
struct Instance {
    mesh: Arc<Mesh>,
    /// Maps directions from the world to the mesh's frame.
    turn: Mat3A,
    /// The eye in the mesh's frame.
    eye: Vec3A,
    /// Whether only its front counts.
    front: bool,
    /// Its index among the frame's.
    index: u32,
}

/// Working memory.
#[derive(Default)]
struct Memory {
    instances: Vec<u32>,
    triangles: Vec<u32>,
    /// Candidates for the first hit: their distance along each of four rays, and their index.
    hits: Vec<(Vec4, u32)>,
}

/// The relative distance within which further hits count as first as well: which of two coincident surfaces
/// is visible depends on rounding.
const TIE: f32 = 1e-6;

/// The side of the squares of pixels that one thread casts in turn, so that rays find their neighbours' data
/// in its cache. Even, since rays go two by two.
const TILE: usize = 8;

impl Placed {
    /// `ids` of `scene` for `view`. Makes missing `meshes`.
    pub(crate) fn new(scene: &Scene, view: &View, ids: &[DrawableId], meshes: &mut Meshes) -> Self {
        let find = |id: &DrawableId| {
            let (drawable, part) = scene.part(*id)?;
            Some((drawable, part, Shape::of(drawable, &part)))
        };
        let found: Vec<_> = ids.par_iter().map(find).collect();
        meshes.make(scene, found.iter().flatten().map(|(drawable, _, (shape, _))| (*shape, **drawable)));
        let solids = view.sections().is_empty().then(|| Solids::new(view));
        let mut placed = Self::default();
        let mut boxes = Vec::with_capacity(ids.len());
        for (index, found) in (0..).zip(&found) {
            let instance = found.and_then(|(drawable, part, (shape, turn))| {
                let facing = solids.as_ref().map_or(Facing::Both, |solids| solids.facing(drawable, &part));
                let eye = (turn * (view.eye() - part.origin())).as_vec3a();
                let (front, turn) = (facing != Facing::Both, turn.as_mat3().into());
                let bounds = box_about(view, &part)?;
                let instance = Instance { mesh: Arc::clone(meshes.get(shape)?), turn, eye, front, index };
                (eye.abs().max_element() <= LARGEST).then_some((instance, bounds))
            });
            match instance {
                Some((instance, bounds)) => {
                    placed.instances.push(instance);
                    boxes.push(bounds);
                }
                None => placed.undecided.push(index),
            }
        }
        let (tree, order) = Tree::over(&boxes, 1);
        let instances = order.iter().filter_map(|&index| placed.instances.get(index as usize).cloned());
        Self { instances: instances.collect(), tree, ..placed }
    }

    /// The indices of undecidable drawables. They count as visible.
    pub(crate) fn undecided(&self) -> &[u32] {
        &self.undecided
    }

    /// Calls `hit` with each pixel of `view`, counted row by row from the top left, and the index of its
    /// visible drawable; with each index, if surfaces coincide.
    pub(crate) fn cast(&self, view: &View, hit: impl Fn(usize, u32) + Sync) {
        let rays = PixelRays::new(view);
        let (width, height) = (view.viewport().width() as usize, view.viewport().height() as usize);
        let across = width.div_ceil(TILE);
        let tiles = (0..across * height.div_ceil(TILE)).into_par_iter();
        tiles.for_each_init(Memory::default, |memory, tile| {
            let (left, top) = (tile % across * TILE, tile / across * TILE);
            for row in (top..height.min(top + TILE)).step_by(2) {
                for column in (left..width.min(left + TILE)).step_by(2) {
                    let (packet, end) = rays.packet(column, row);
                    self.first(&packet, end, memory, |lane, index| {
                        let (column, row) = (column + lane % 2, row + lane / 2);
                        // The picture may end within the four.
                        if column < width && row < height {
                            hit(row * width + column, index);
                        }
                    });
                }
            }
        });
    }

    /// Calls `hit` with each of the four rays that has a hit by `end`, and its first hit.
    fn first(&self, packet: &Packet, end: Vec4, memory: &mut Memory, mut hit: impl FnMut(usize, u32)) {
        let Memory { instances, triangles, hits } = memory;
        hits.clear();
        let mut end = end;
        self.tree.visit(packet, &mut end, instances, |leaf, end| {
            for instance in self.instances.get(leaf).unwrap_or_default() {
                let packet = packet.seen_from(instance.eye, &instance.turn);
                let distance = instance.mesh.first(&packet, *end, instance.front, triangles);
                if distance.cmple(*end).any() {
                    hits.push((distance, instance.index));
                    *end = end.min(distance * (1.0 + TIE));
                }
            }
        });
        for (distance, index) in &*hits {
            let first = distance.cmple(end).bitmask();
            (0..4).filter(|lane| first >> lane & 1 == 1).for_each(|lane| hit(lane, *index));
        }
    }
}

/// The node's box about the eye, rounded outwards. `None` if it is too large.
fn box_about(view: &View, node: &Node) -> Option<Aabb> {
    let (min, max) = node.world_box();
    let low = (min - view.eye()).as_vec3().to_array().map(f32::next_down);
    let high = (max - view.eye()).as_vec3().to_array().map(f32::next_up);
    let bounds = Aabb::new(low.into(), high.into());
    let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
    (largest <= LARGEST).then_some(bounds)
}
