//! Objects placed in the world: the leaves of the tree.

use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use super::CookError;
use super::levels::LeveledMesh;
use super::linear::{WorldBox, largest_stretch};
use crate::{Model, Object};
use trimaran_scene::Vertex;

/// An object with triangles.
#[derive(Debug)]
pub(super) struct Leaf {
    /// Index into the model's objects.
    pub(super) object: u32,
    /// Index into the meshes.
    pub(super) mesh: u32,
    /// Local frame to world without translation, as stored.
    pub(super) linear: Mat3,
    /// The local frame's origin in the world.
    pub(super) origin: DVec3,
    /// The largest stretch of a distance by `linear`.
    pub(super) stretch: f64,
    /// The box around all vertices as stored, under the placement as stored.
    pub(super) world: WorldBox,
}

/// Places all objects whose mesh has triangles, in the model's order.
pub(super) fn place_objects(model: &Model, meshes: &[Option<LeveledMesh>]) -> Result<Vec<Leaf>, CookError> {
    model
        .objects
        .par_iter()
        .enumerate()
        .filter_map(|(index, object)| {
            let mesh = meshes.get(object.mesh as usize)?.as_ref()?;
            let leaf = Leaf::new(index as u32, object, mesh);
            Some(leaf.ok_or_else(|| CookError::Placement { object: index, name: object.name.clone() }))
        })
        .collect()
}

/// Refuses a scene of more than `limit` nodes, before any are made. Nodes above the objects are at most as
/// many.
pub(super) fn check_nodes(
    model: &Model,
    meshes: &[Option<LeveledMesh>],
    leaves: &[Leaf],
    limit: usize,
) -> Result<(), CookError> {
    // How many objects place each mesh, and the first of them.
    let mut placed = vec![(0_usize, 0_u32); meshes.len()];
    for leaf in leaves {
        if let Some((count, first)) = placed.get_mut(leaf.mesh as usize) {
            if *count == 0 {
                *first = leaf.object;
            }
            *count += 1;
        }
    }
    let each = |mesh: &Option<LeveledMesh>| mesh.as_ref().map_or(0, |mesh| mesh.clusters.len().max(1));
    let all = || meshes.iter().map(each).zip(&placed);
    let below = all().fold(0_usize, |sum, (own, (count, _))| sum.saturating_add(own.saturating_mul(*count)));
    let nodes = below.saturating_add(leaves.len());
    if nodes <= limit {
        return Ok(());
    }
    let most = all().max_by_key(|(own, (count, _))| own.saturating_mul(*count));
    let (own, object) = most.map_or((0, 0), |(own, &(_, first))| (own, first as usize));
    let name = model.objects.get(object).map(|object| object.name.clone()).unwrap_or_default();
    Err(CookError::TooManyNodes { nodes, limit, object, name, own })
}

impl Leaf {
    fn new(index: u32, object: &Object, mesh: &LeveledMesh) -> Option<Self> {
        let linear = object.to_world.matrix3.as_mat3();
        let origin = object.to_world.transform_point3(mesh.centre.as_dvec3());
        let exact = linear.as_dmat3();
        let to_world = DAffine3::from_mat3_translation(exact, origin);
        let world = bounds(&to_world, mesh).padded();
        let stretch = largest_stretch(exact);
        let coarsest = mesh.levels.last().map_or(0.0, |level| f64::from(level.error) * stretch);
        let sound = linear.is_finite()
            && origin.is_finite()
            && world.min.is_finite()
            && world.max.is_finite()
            && coarsest < f64::from(f32::MAX);
        sound.then_some(Self { object: index, mesh: object.mesh, linear, origin, stretch, world })
    }

    /// A vertex of the mesh in the world.
    pub(super) fn to_world(&self, vertex: &Vertex) -> DVec3 {
        self.linear.as_dmat3() * Vec3::from_array(vertex.position).as_dvec3() + self.origin
    }

    /// A local error in world metres, rounded up.
    pub(super) fn world_error(&self, local: f32) -> f32 {
        round_up(f64::from(local) * self.stretch)
    }
}

/// The least single-precision number that is not below `value`.
pub(super) fn round_up(value: f64) -> f32 {
    let near = value as f32;
    if f64::from(near) < value { near.next_up() } else { near }
}

/// The box around the mesh in the world. Levels use the finest one's vertices, so it contains all of them.
fn bounds(to_world: &DAffine3, mesh: &LeveledMesh) -> WorldBox {
    if keeps_axes(&to_world.matrix3) {
        // The box of the corners is the box of all.
        WorldBox::around([mesh.min, mesh.max].map(|corner| to_world.transform_point3(corner.as_dvec3())))
    } else {
        let point = |v: &Vertex| to_world.transform_point3(Vec3::from_array(v.position).as_dvec3());
        WorldBox::around(mesh.vertices.iter().map(point))
    }
}

/// Whether each world axis depends on only one local axis.
fn keeps_axes(a: &DMat3) -> bool {
    (0..3).all(|row| a.row(row).to_array().iter().filter(|&&c| c != 0.0).count() <= 1)
}
