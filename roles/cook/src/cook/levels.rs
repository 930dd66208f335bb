//! Levels of detail of one mesh, shared by all objects that place it.

use std::ops::Range;

use glam::Vec3;
use meshopt::SimplifyOptions;
use rayon::prelude::*;

use super::chain::{Aim, COARSEST, FEW, Triangles, halve};
use super::clusters::{self, ClusterNode};
use super::large_mesh::{self, LargeMesh};
use super::linear::bounds;
use super::{Phase, Progress, see_through};
use crate::lists::put;
use crate::{Mesh, Model};
use trimaran_scene::Vertex;

/// Meshes farther from their origin than this many times their radius are recentred: a matrix applied in
/// single precision would move them.
const FAR: f32 = 4.0;

/// One level: indices into the mesh's vertices, and its certified error in the mesh's frame.
#[derive(Debug)]
pub(super) struct Level {
    pub(super) indices: Vec<u32>,
    /// The upper bound of the indices: coarser levels use fewer of the first vertices.
    pub(super) vertex_count: u32,
    pub(super) error: f32,
    /// Its pieces, as positions in the indices; none if it is in clusters.
    pub(super) pieces: Vec<Range<u32>>,
}

impl Level {
    fn cut(&mut self, vertices: &[Vertex]) {
        self.pieces = clusters::pieces(vertices, &mut self.indices).into_iter().map(|(at, _)| at).collect();
    }
}

/// A mesh with its levels.
#[derive(Debug)]
pub(super) struct LeveledMesh {
    /// The offset subtracted from the model's positions.
    pub(super) centre: Vec3,
    pub(super) vertices: Vec<Vertex>,
    /// Of the whole mesh, finest first.
    pub(super) levels: Vec<Level>,
    /// Levels of a large mesh's parts: its clusters' nodes refer to them.
    pub(super) part_levels: Vec<Level>,
    /// The tree of the finest level's clusters; empty for a small mesh.
    pub(super) clusters: Vec<ClusterNode>,
    pub(super) min: Vec3,
    pub(super) max: Vec3,
}

/// Simplifies each mesh that an object places. `None` for the others, and for those without a proper
/// triangle.
pub(super) fn simplify_meshes(model: &Model, progress: &dyn Progress) -> Vec<Option<LeveledMesh>> {
    let mut placed = vec![false; model.meshes.len()];
    for object in &model.objects {
        put(&mut placed, object.mesh, true);
    }
    progress.begin(Phase::Levels, model.meshes.len());
    model
        .meshes
        .par_iter()
        .zip(placed)
        .with_max_len(16) // a few meshes hold most of the triangles
        .map(|(mesh, placed)| {
            let leveled = if placed { LeveledMesh::new(mesh) } else { None };
            progress.advance(1);
            leveled
        })
        .collect()
}

impl LeveledMesh {
    fn new(mesh: &Mesh) -> Option<Self> {
        let (centre, vertices, finest) = clean(mesh)?;
        let positions: Vec<Vec3> = vertices.iter().map(|v| Vec3::from_array(v.position)).collect();
        let (min, max) = bounds(positions.iter().copied());
        let largest_error = COARSEST * min.distance(max);
        let leveled = Self {
            centre,
            vertices: Vec::new(),
            levels: Vec::new(),
            part_levels: Vec::new(),
            clusters: Vec::new(),
            min,
            max,
        };
        Some(if finest.len() / 3 > large_mesh::LARGE {
            leveled.with_parts(&vertices, LargeMesh::new(&vertices, &positions, &finest))
        } else {
            leveled.whole(&vertices, &positions, finest, largest_error)
        })
    }

    /// All levels are of the whole mesh.
    fn whole(self, vertices: &[Vertex], positions: &[Vec3], finest: Vec<u32>, largest_error: f32) -> Self {
        let aim =
            Aim { few: FEW, most: clusters::most_whole(finest.len() / 3), from_error: 0.0, largest_error };
        let mut chain = halve(positions, &finest, aim, |former, adapter, target| {
            let options = SimplifyOptions::Prune | SimplifyOptions::ErrorAbsolute;
            meshopt::simplify(former, adapter, target, largest_error, options, None)
        });
        chain.insert(0, (finest, 0.0));
        for (indices, _) in &mut chain {
            meshopt::optimize_vertex_cache_in_place(indices, vertices.len());
        }
        let (vertices, mut levels) = share_vertices(vertices, chain);
        let clusters = levels.first_mut().map(|finest| clusters::cut(&vertices, &mut finest.indices));
        let clusters = clusters.unwrap_or_default();
        let in_clusters = usize::from(!clusters.is_empty());
        levels.iter_mut().skip(in_clusters).for_each(|level| level.cut(&vertices));
        Self { vertices, levels, clusters, ..self }
    }

    /// Its parts have levels of their own.
    fn with_parts(self, vertices: &[Vertex], mesh: LargeMesh) -> Self {
        let LargeMesh { clusters, finest, part_levels, levels: whole } = mesh;
        let parts = part_levels.len();
        let chain = std::iter::once((finest, 0.0)).chain(part_levels).chain(whole).collect();
        let (vertices, mut levels) = share_vertices(vertices, chain);
        levels.par_iter_mut().skip(1).for_each(|level| level.cut(&vertices));
        let part_levels = levels.drain(1..=parts).collect();
        Self { vertices, levels, part_levels, clusters, ..self }
    }
}

/// Recentres a mesh far from its origin, welds equal vertices, drops triangles with two equal corners.
fn clean(mesh: &Mesh) -> Option<(Vec3, Vec<Vertex>, Vec<u32>)> {
    let (min, max) = bounds(mesh.indices.iter().filter_map(|&i| mesh.positions.get(i as usize).copied()));
    let middle = min.midpoint(max);
    let centre = if middle.length() > FAR * 0.5 * min.distance(max) { middle } else { Vec3::ZERO };
    let through = see_through::is_see_through(mesh);
    let coloured = |colour| if through { colour } else { see_through::solid(colour) };
    let corners: Vec<Vertex> = mesh
        .positions
        .iter()
        .zip(&mesh.colours)
        // Adding zero turns -0 into 0, so that equal positions have equal bits.
        .map(|(&p, &colour)| Vertex::new((p - centre + Vec3::ZERO).to_array(), coloured(colour)))
        .collect();
    let (count, remap) = meshopt::generate_vertex_remap(&corners, Some(&mesh.indices));
    let at = |i: u32| corners.get(i as usize).map(|v| v.position);
    let indices: Vec<u32> = mesh
        .indices
        .as_chunks::<3>()
        .0
        .iter()
        .filter(|&&[a, b, c]| at(a) != at(b) && at(b) != at(c) && at(c) != at(a))
        .flatten()
        .filter_map(|&i| remap.get(i as usize).copied())
        .collect();
    let mut vertices = vec![Vertex::new([0.0; 3], trimaran_scene::Rgba8([0; 4])); count];
    for (vertex, &slot) in corners.iter().zip(&remap) {
        put(&mut vertices, slot, *vertex);
    }
    (!indices.is_empty()).then_some((centre, vertices, indices))
}

/// Orders the vertices so that each level uses the first few: those of the coarsest level come first.
fn share_vertices(vertices: &[Vertex], chain: Vec<Triangles>) -> (Vec<Vertex>, Vec<Level>) {
    let mut order = vec![u32::MAX; vertices.len()];
    let mut shared = Vec::with_capacity(vertices.len());
    let mut levels: Vec<Level> = Vec::with_capacity(chain.len());
    for (mut indices, error) in chain.into_iter().rev() {
        for index in &mut indices {
            let (Some(slot), Some(vertex)) = (order.get_mut(*index as usize), vertices.get(*index as usize))
            else {
                continue;
            };
            if *slot == u32::MAX {
                *slot = shared.len() as u32;
                shared.push(*vertex);
            }
            *index = *slot;
        }
        levels.push(Level { indices, vertex_count: shared.len() as u32, error, pieces: Vec::new() });
    }
    levels.reverse();
    (shared, levels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use trimaran_scene::Rgba8;

    fn mesh(positions: &[Vec3], indices: &[u32]) -> Mesh {
        let colours = vec![Rgba8([9, 9, 9, 255]); positions.len()];
        Mesh { positions: positions.to_vec(), colours, indices: indices.to_vec() }
    }

    #[test]
    fn a_mesh_farther_from_its_origin_than_twice_its_length_is_recentred() {
        for size in [1.0 / 64.0, 1.0, 64.0] {
            for (distance, centred) in [(1.875, false), (2.0, false), (2.125, true)] {
                let middle = Vec3::X * distance * size;
                let positions = [-0.5, 0.25, 0.5].map(|x| middle + Vec3::X * x * size);
                let (centre, vertices, _) = clean(&mesh(&positions, &[0, 1, 2])).unwrap();
                assert_eq!(centre, if centred { middle } else { Vec3::ZERO }, "{distance} at {size}");
                let placed: Vec<Vec3> =
                    vertices.iter().map(|v| centre + Vec3::from_array(v.position)).collect();
                assert_eq!(placed, positions, "{distance} at {size}");
            }
        }
    }

    #[test]
    fn equal_corners_weld_and_triangles_with_two_of_them_are_dropped() {
        let positions = [Vec3::ZERO, -Vec3::ZERO, Vec3::X, Vec3::Y];
        let thin = [[0, 1, 2], [0, 2, 1], [2, 0, 1]];
        let proper = [[0, 2, 3], [1, 3, 2]];
        let (_, vertices, indices) =
            clean(&mesh(&positions, &[&thin[..], &proper].concat().concat())).unwrap();
        assert_eq!((vertices.len(), indices), (3, vec![0, 1, 2, 0, 2, 1]));
    }
}
