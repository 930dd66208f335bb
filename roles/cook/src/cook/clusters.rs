//! Cuts levels into pieces of neighbouring triangles that are culled one by one, and the finest level of a
//! large mesh into clusters.
//!
//! An object is a unit of names, not of visibility: of a brick with a thousand triangles the camera sees the
//! studs and never the tubes inside. So a mesh of many triangles has a small tree of its own below it, whose
//! leaves draw a few dozen triangles each. Other levels need no tree: all of their pieces are tested once the
//! level is drawn. All triangles stay unchanged, each in exactly one cluster or piece, in the mesh's own
//! frame.

use std::ops::Range;

use glam::Vec3;

use super::linear::WorldBox;
use super::tree;
use trimaran_scene::Vertex;

/// Meshes of more triangles than this are cut.
const LARGE: usize = 192;
/// The most triangles of a cluster, and of a piece of a level.
const MOST: usize = 48;

/// A mesh in clusters has at least this many times the triangles of its coarser levels. Levels of a half
/// would save up to a fifth of the triangles drawn at small errors, and cost as much of the file.
const WORTH: usize = 4;

/// A node of a mesh's cluster tree, in breadth-first order; the first stands for the whole mesh.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ClusterNode {
    /// Empty for a cluster.
    pub(super) children: Range<u32>,
    /// The box around the triangles below, in the mesh's frame.
    pub(super) min: Vec3,
    /// Its upper corner.
    pub(super) max: Vec3,
    /// A cluster's triangles, as positions in the finest level's indices.
    pub(super) indices: Range<u32>,
    /// The levels of a part of a large mesh except the finest, among those of all parts.
    pub(super) levels: Range<u32>,
}

/// The most triangles that a coarse level of a mesh of `finest` triangles may have.
pub(super) const fn most_whole(finest: usize) -> usize {
    if finest > LARGE { finest / WORTH } else { usize::MAX }
}

/// Cuts the triangles of `finest`, and makes those of a cluster contiguous. Returns the tree, empty if the
/// mesh is small.
pub(super) fn cut(vertices: &[Vertex], finest: &mut Vec<u32>) -> Vec<ClusterNode> {
    if finest.len() / 3 <= LARGE {
        return Vec::new();
    }
    let clusters = pieces(vertices, finest);
    let boxes: Vec<WorldBox> = clusters.iter().map(|(_, bounds)| *bounds).collect();
    let node = |node: tree::TreeNode| ClusterNode {
        children: node.children,
        // Corners of boxes around single-precision points are single-precision numbers.
        min: node.bounds.min.as_vec3(),
        max: node.bounds.max.as_vec3(),
        indices: node
            .item
            .and_then(|item| clusters.get(item as usize))
            .map_or(0..0, |(range, _)| range.clone()),
        levels: 0..0,
    };
    tree::build(&boxes).into_iter().map(node).collect()
}

/// Cuts a level into pieces of at most [`MOST`] neighbouring triangles, and makes those of a piece
/// contiguous. Returns each one's positions in the indices, and its box.
pub(super) fn pieces(vertices: &[Vertex], level: &mut Vec<u32>) -> Vec<(Range<u32>, WorldBox)> {
    let triangles = level.as_chunks::<3>().0;
    let boxes: Vec<WorldBox> = triangles.iter().map(|corners| bounds(vertices, corners)).collect();
    let groups = if triangles.len() > MOST {
        tree::groups(&boxes, MOST)
    } else {
        vec![(0..triangles.len() as u32).collect()]
    };
    let mut sorted = Vec::with_capacity(level.len());
    let mut pieces = Vec::with_capacity(groups.len());
    for group in &groups {
        let start = sorted.len() as u32;
        let members = group.iter().filter_map(|&triangle| triangles.get(triangle as usize));
        sorted.extend(members.flatten());
        let around =
            group.iter().filter_map(|&t| boxes.get(t as usize)).fold(WorldBox::EMPTY, |b, &t| b.union(t));
        pieces.push((start..sorted.len() as u32, around));
    }
    *level = sorted;
    pieces
}

/// The box around a triangle.
pub(super) fn bounds(vertices: &[Vertex], corners: &[u32; 3]) -> WorldBox {
    let corners = corners.iter().filter_map(|&index| vertices.get(index as usize));
    WorldBox::around(corners.map(|vertex| Vec3::from_array(vertex.position).as_dvec3()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use trimaran_scene::Rgba8;

    /// A strip of `count` triangles along x.
    fn strip(count: u32) -> (Vec<Vertex>, Vec<u32>) {
        let vertex = |i: u32| Vertex::new([i as f32, (i % 2) as f32, 0.0], Rgba8([255; 4]));
        ((0..count + 2).map(vertex).collect(), (0..count).flat_map(|i| [i, i + 1, i + 2]).collect())
    }

    #[test]
    fn a_small_mesh_stays_whole() {
        let (vertices, mut indices) = strip(LARGE as u32);
        let before = indices.clone();
        assert_eq!(cut(&vertices, &mut indices), []);
        assert_eq!(indices, before);
    }

    #[test]
    fn every_triangle_is_in_one_cluster_within_its_box() {
        let (vertices, mut indices) = strip(5000);
        let mut before = indices.as_chunks::<3>().0.to_vec();
        let tree = cut(&vertices, &mut indices);
        let mut after = indices.as_chunks::<3>().0.to_vec();
        let mut covered = 0;
        for node in tree.iter().filter(|node| node.children.is_empty()) {
            assert!(node.indices.len() <= 3 * MOST && !node.indices.is_empty());
            covered += node.indices.len();
            for &index in &indices[node.indices.start as usize..node.indices.end as usize] {
                let p = Vec3::from_array(vertices[index as usize].position);
                assert!(p.cmpge(node.min).all() && p.cmple(node.max).all());
            }
        }
        assert_eq!(covered, indices.len());
        before.sort_unstable();
        after.sort_unstable();
        assert_eq!(before, after);
        let longest =
            tree.iter().filter(|n| n.children.is_empty()).map(|n| n.max.x - n.min.x).fold(0.0, f32::max);
        assert!(longest < 110.0, "a cluster of a strip is short, not {longest}");
    }
}
