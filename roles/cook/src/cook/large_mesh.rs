//! Large meshes, such as a terrain or a scanned hull. They are cut into parts with levels of their own.
//!
//! A mesh with levels only of the whole is drawn finely everywhere if the eye is near any of it. So a large
//! mesh is cut into parts of neighbouring triangles, with a small tree over the parts below the object. A
//! part's levels are made of its own triangles. The levels of a node over parts are made of the coarsest
//! levels of the nodes below, and so are the object's own. So the input of simplification shrinks from height
//! to height, and the work is a few times that for one level of the mesh.
//!
//! No cracks: a vertex shared by nodes stays in all levels of either, and only the levels of a node above
//! both may drop it. So the border of two nodes is the same line of edges at all their levels.
//!
//! A part's levels are measured against its finest triangles. Above, the triangle inequality bounds the
//! error: the largest error of a node's inputs, plus the distance from those.

use glam::Vec3;
use rayon::prelude::*;

use super::chain::{Aim, COARSEST, FEW, Triangles};
use super::clusters::{self, ClusterNode};
use super::linear::WorldBox;
use super::submesh::Submesh;
use super::tree::{self, TreeNode};
use crate::lists::put;
use trimaran_scene::Vertex;

/// Meshes of more triangles than this are cut into parts.
pub(super) const LARGE: usize = 1 << 16;
/// The most triangles of a part. A level is chosen for all of its part: with parts of 16,384 triangles, 1.6
/// times as many were drawn on a walk over uneven ground.
const PART: usize = 1 << 11;
/// Levels of a part, and of a node over parts, end at this many triangles: eight of them are no more than a
/// part.
const COARSE: usize = PART / 8;
/// ... or at this many times the fixed vertices. With hardly any free ones, a level has a large error, and so
/// have all above it: at a quarter of a million triangles over a bumpy ball, fourteen times as large.
const FREE: usize = 5;

/// A mesh in parts.
#[derive(Debug)]
pub(super) struct LargeMesh {
    /// The tree over the parts, with the tree of clusters below each. The first node stands for the whole
    /// mesh.
    pub(super) clusters: Vec<ClusterNode>,
    /// The finest triangles, those of a cluster contiguous.
    pub(super) finest: Vec<u32>,
    /// The levels of the parts and of the nodes over them except the first, by the nodes' references.
    pub(super) part_levels: Vec<Triangles>,
    /// The levels of the whole mesh except the finest, finest first.
    pub(super) levels: Vec<Triangles>,
}

impl LargeMesh {
    /// Cuts a mesh of more than [`LARGE`] triangles.
    pub(super) fn new(vertices: &[Vertex], positions: &[Vec3], finest: &[u32]) -> Self {
        let parts = Parts::new(vertices, positions, finest);
        let mut chains = parts.all_levels(positions);
        let mut mesh = Self {
            clusters: parts.tree.iter().map(blank).collect(),
            finest: Vec::with_capacity(finest.len()),
            part_levels: Vec::new(),
            levels: chains.first_mut().map(std::mem::take).unwrap_or_default(),
        };
        // From behind, so that levels of larger nodes come after those of smaller ones, as within a chain.
        for (node, chain) in mesh.clusters.iter_mut().zip(chains).rev() {
            let first = mesh.part_levels.len() as u32;
            mesh.part_levels.extend(chain);
            node.levels = first..mesh.part_levels.len() as u32;
        }
        mesh.add_clusters(vertices, parts);
        mesh
    }

    /// Puts each part's clusters below its node.
    fn add_clusters(&mut self, vertices: &[Vertex], parts: Parts) {
        let cut = |mut part: Vec<u32>| {
            meshopt::optimize_vertex_cache_in_place(&mut part, vertices.len());
            (clusters::cut(vertices, &mut part), part)
        };
        let cut: Vec<(Vec<ClusterNode>, Vec<u32>)> = parts.triangles.into_par_iter().map(cut).collect();
        for (place, node) in parts.tree.iter().enumerate() {
            let Some((clusters, part)) = node.item.and_then(|item| cut.get(item as usize)) else { continue };
            let start = self.finest.len() as u32;
            self.finest.extend(part);
            // The part stands for the first of its clusters' nodes.
            let before = self.clusters.len() as u32 - 1;
            let moved = |range: &std::ops::Range<u32>, by: u32| range.start + by..range.end + by;
            if let Some(own) = self.clusters.get_mut(place) {
                match clusters.first() {
                    Some(first) => own.children = moved(&first.children, before),
                    None => own.indices = start..self.finest.len() as u32,
                }
            }
            self.clusters.extend(clusters.iter().skip(1).map(|cluster| ClusterNode {
                children: moved(&cluster.children, before),
                indices: moved(&cluster.indices, start),
                ..cluster.clone()
            }));
        }
    }
}

/// A node of the tree over parts, without levels and triangles.
fn blank(node: &TreeNode) -> ClusterNode {
    ClusterNode {
        children: node.children.clone(),
        // Corners of boxes around single-precision points are single-precision numbers.
        min: node.bounds.min.as_vec3(),
        max: node.bounds.max.as_vec3(),
        indices: 0..0,
        levels: 0..0,
    }
}

/// The parts, the tree over them, and their shared vertices.
#[derive(Debug)]
struct Parts {
    tree: Vec<TreeNode>,
    /// The finest triangles of each part.
    triangles: Vec<Vec<u32>>,
    /// For each vertex the lowest node with all triangles at its position.
    homes: Vec<u32>,
}

impl Parts {
    fn new(vertices: &[Vertex], positions: &[Vec3], finest: &[u32]) -> Self {
        let corners = finest.as_chunks::<3>().0;
        let boxes: Vec<WorldBox> =
            corners.par_iter().map(|corners| clusters::bounds(vertices, corners)).collect();
        let groups = tree::groups(&boxes, PART);
        let around = |group: &Vec<u32>| {
            group.iter().filter_map(|&t| boxes.get(t as usize)).fold(WorldBox::EMPTY, |b, &t| b.union(t))
        };
        let tree = tree::build(&groups.iter().map(around).collect::<Vec<_>>());
        let triangles = groups
            .iter()
            .map(|group| group.iter().filter_map(|&t| corners.get(t as usize)).flatten().copied().collect())
            .collect();
        let mut parts = Self { tree, triangles, homes: Vec::new() };
        parts.homes = parts.homes(positions);
        parts
    }

    fn homes(&self, positions: &[Vec3]) -> Vec<u32> {
        let (count, places) = meshopt::generate_vertex_remap(positions, None);
        let mut homes = vec![None; count];
        for (node, record) in (0_u32..).zip(&self.tree) {
            let part = record.item.and_then(|item| self.triangles.get(item as usize));
            for &vertex in part.into_iter().flatten() {
                let place = places.get(vertex as usize).map_or(0, |&place| place as usize);
                if let Some(home) = homes.get_mut(place) {
                    *home = Some(home.map_or(node, |home| self.lowest_above(home, node)));
                }
            }
        }
        let home = |&place: &u32| homes.get(place as usize).copied().flatten().unwrap_or_default();
        places.iter().map(home).collect()
    }

    /// The lowest node at or above both. Parents stand before their children.
    fn lowest_above(&self, mut a: u32, mut b: u32) -> u32 {
        let parent =
            |node: u32| self.tree.get(node as usize).and_then(|node| node.parent).unwrap_or_default();
        while a != b {
            if a > b {
                a = parent(a);
            } else {
                b = parent(b);
            }
        }
        a
    }

    /// The levels of each node except the finest, from the parts up to the whole mesh.
    fn all_levels(&self, positions: &[Vec3]) -> Vec<Vec<Triangles>> {
        let mut chains: Vec<Vec<Triangles>> = vec![Vec::new(); self.tree.len()];
        let is_part = |&node: &u32| self.tree.get(node as usize).is_some_and(|node| node.item.is_some());
        let parts = (0..self.tree.len() as u32).filter(is_part).collect();
        for generation in std::iter::once(parts).chain(tree::by_height(&self.tree)) {
            let level = |node| (node, self.levels_of(node, &chains, positions));
            let made: Vec<(u32, Vec<Triangles>)> = generation.into_par_iter().map(level).collect();
            for (node, chain) in made {
                put(&mut chains, node, chain);
            }
        }
        chains
    }

    fn levels_of(&self, node: u32, chains: &[Vec<Triangles>], positions: &[Vec3]) -> Vec<Triangles> {
        let Some(record) = self.tree.get(node as usize) else { return Vec::new() };
        let mut first = (Vec::new(), 0.0);
        self.gather(node, chains, &mut first);
        // A vertex whose home is above is shared with this node's neighbours.
        let is_held = |vertex: u32| self.homes.get(vertex as usize).is_some_and(|&home| home < node);
        let submesh = Submesh::new(positions, &first.0, is_held);
        let aim = Aim {
            // The whole mesh has no neighbours.
            few: if node == 0 { FEW } else { COARSE.max(FREE * submesh.held_count()) },
            most: record.item.map_or(usize::MAX, |_| clusters::most_whole(first.0.len() / 3)),
            from_error: first.1,
            largest_error: COARSEST * record.bounds.diagonal() as f32,
        };
        submesh.levels(aim)
    }

    /// Adds the inputs of a node's levels: the coarsest levels of the nodes below it, or the finest triangles
    /// of a part.
    fn gather(&self, node: u32, chains: &[Vec<Triangles>], all: &mut Triangles) {
        let Some(record) = self.tree.get(node as usize) else { return };
        if let Some(part) = record.item.and_then(|item| self.triangles.get(item as usize)) {
            all.0.extend(part);
        }
        for child in record.children.clone() {
            match chains.get(child as usize).and_then(|chain| chain.last()) {
                Some((coarsest, error)) => {
                    all.0.extend(coarsest);
                    all.1 = all.1.max(*error);
                }
                None => self.gather(child, chains, all),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trimaran_scene::Rgba8;

    /// A rough height field of `2 * n * n` triangles.
    fn field(n: u32) -> (Vec<Vertex>, Vec<Vec3>, Vec<u32>) {
        let rough = |i: u32, j: u32| (i.wrapping_mul(2_654_435_761) ^ j.wrapping_mul(40_503)) % 1000;
        let at = |i: u32, j: u32| {
            Vec3::new(i as f32, 0.002 * rough(i, j) as f32 + (0.05 * j as f32).sin(), j as f32)
        };
        let positions: Vec<Vec3> = (0..=n).flat_map(|i| (0..=n).map(move |j| at(i, j))).collect();
        let square = |a: u32| [a, a + 1, a + n + 2, a, a + n + 2, a + n + 1];
        let indices = (0..n).flat_map(|i| (0..n).flat_map(move |j| square(i * (n + 1) + j))).collect();
        let vertex = |p: &Vec3| Vertex::new(p.to_array(), Rgba8([255; 4]));
        (positions.iter().map(vertex).collect(), positions, indices)
    }

    /// The measurements, and their number, are a few times the mesh: each level of a node is measured against
    /// its first input.
    #[test]
    fn the_work_is_a_few_times_that_for_one_level() {
        let (vertices, positions, finest) = field(256);
        let parts = Parts::new(&vertices, &positions, &finest);
        let chains = parts.all_levels(&positions);
        let mut measured = 0;
        for (node, chain) in (0_u32..).zip(&chains) {
            let mut first = (Vec::new(), 0.0);
            parts.gather(node, &chains, &mut first);
            measured += chain.iter().map(|(level, _)| (first.0.len() + level.len()) / 3).sum::<usize>();
        }
        let triangles = finest.len() / 3;
        assert!(measured > 2 * triangles && measured < 6 * triangles, "{measured} for {triangles}");
    }

    #[test]
    fn a_vertex_is_held_by_the_nodes_below_its_home_and_errors_rise_to_it() {
        let (vertices, positions, finest) = field(190);
        let parts = Parts::new(&vertices, &positions, &finest);
        let chains = parts.all_levels(&positions);
        let mut held = 0;
        for (node, record) in (1_u32..).zip(&parts.tree[1..]) {
            let mut first = (Vec::new(), 0.0);
            parts.gather(node, &chains, &mut first);
            let mut borders: Vec<u32> =
                first.0.into_iter().filter(|&v| parts.homes[v as usize] < node).collect();
            borders.sort_unstable();
            borders.dedup();
            held += borders.len();
            for (level, error) in &chains[node as usize] {
                assert!(borders.iter().all(|vertex| level.contains(vertex)), "node {node}");
                let above = record.parent.map(|parent| &chains[parent as usize]);
                assert!(above.into_iter().flatten().all(|(_, coarser)| coarser >= error), "node {node}");
            }
        }
        assert!(held > 1000, "{held} vertices are on a border of a node");
        let own = |node: u32| parts.tree[node as usize].item.is_some();
        assert!(parts.homes.contains(&0) && parts.homes.iter().any(|&home| own(home)));
    }

    #[test]
    fn every_triangle_is_in_one_cluster() {
        let (vertices, positions, finest) = field(190);
        let mesh = LargeMesh::new(&vertices, &positions, &finest);
        let mut clusters: Vec<&ClusterNode> =
            mesh.clusters.iter().filter(|c| c.children.is_empty()).collect();
        clusters.sort_by_key(|cluster| cluster.indices.start);
        let mut covered = 0;
        for cluster in clusters {
            assert_eq!(cluster.indices.start as usize, covered, "clusters follow each other");
            covered = cluster.indices.end as usize;
            for &index in &mesh.finest[cluster.indices.start as usize..covered] {
                let p = positions[index as usize];
                assert!(p.cmpge(cluster.min).all() && p.cmple(cluster.max).all());
            }
        }
        assert_eq!(covered, finest.len());
        let sorted = |indices: &[u32]| {
            let turned =
                indices.as_chunks().0.iter().map(|&[a, b, c]: &[u32; 3]| [[a, b, c], [b, c, a], [c, a, b]]);
            let mut triangles: Vec<[u32; 3]> = turned.flat_map(|turns| turns.into_iter().min()).collect();
            triangles.sort_unstable();
            triangles
        };
        assert!(sorted(&mesh.finest) == sorted(&finest), "the triangles are those given");
    }
}
