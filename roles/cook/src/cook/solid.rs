//! Which drawables are made of solids: closed surfaces whose triangles all face outwards.
//!
//! A ray from outside enters a solid before it leaves it, so it meets a triangle from its front first. What
//! faces away is never seen, and need not be drawn.
//!
//! Corners are the same if their positions are, to the bit. A drawable is made of solids if along each edge
//! as many triangles run one way as the other, and each part of it that hangs together by edges has a volume.

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use trimaran_scene::{SceneArrays, Sides, Vertex};

/// A part of less volume than this share of its diagonal's cube has none: far below any rod's or plate's, and
/// far above what rounding in f64 makes of a sheet folded flat.
const LEAST_VOLUME: f64 = 1e-12;

/// Marks the drawables that are made of solids.
pub(super) fn mark_solids(arrays: &mut SceneArrays) {
    let SceneArrays { drawables, geometries, .. } = arrays;
    let solid: Vec<bool> =
        geometries.par_iter().map(|geometry| is_solid(&geometry.vertices, &geometry.indices)).collect();
    drawables.par_iter_mut().for_each(|drawable| {
        let is_solid = solid.get(drawable.geometry as usize) == Some(&true);
        drawable.sides = if is_solid { Sides::FRONT } else { Sides::BOTH };
    });
}

/// An edge, as its lesser corner runs to the other.
#[derive(Default)]
struct Edge {
    /// Triangles that run along it, less those that run against it.
    balance: i32,
    /// The last of its triangles.
    triangle: usize,
}

fn is_solid(vertices: &[Vertex], indices: &[u32]) -> bool {
    let Some(triangles) = welded(vertices, indices) else { return false };
    let mut edges: HashMap<[usize; 2], Edge> = HashMap::with_capacity(triangles.len() * 3 / 2);
    let mut parts = Parts::new(triangles.len());
    for (index, (corners, _)) in triangles.iter().enumerate() {
        let [a, b, c] = *corners;
        for [from, to] in [[a, b], [b, c], [c, a]] {
            if from == to {
                continue; // a triangle without area
            }
            let edge =
                edges.entry([from.min(to), from.max(to)]).or_insert(Edge { balance: 0, triangle: index });
            edge.balance += if from < to { 1 } else { -1 };
            parts.join(edge.triangle, index);
            edge.triangle = index;
        }
    }
    edges.values().all(|edge| edge.balance == 0) && parts.have_volumes(&triangles)
}

type Welded = ([usize; 3], [DVec3; 3]);

/// The triangles, with corners that are the same where their positions are. `None` if an index has no vertex.
fn welded(vertices: &[Vertex], indices: &[u32]) -> Option<Vec<Welded>> {
    let mut corners: HashMap<[u32; 3], usize> = HashMap::with_capacity(indices.len() / 6);
    let mut corner = |index: u32| {
        let position = vertices.get(index as usize)?.position;
        let next = corners.len();
        // Zero has two signs.
        let corner = *corners.entry(position.map(|x| (x + 0.0).to_bits())).or_insert(next);
        Some((corner, Vec3::from_array(position).as_dvec3()))
    };
    let (triples, _) = indices.as_chunks::<3>();
    triples
        .iter()
        .map(|&[a, b, c]| {
            let [a, b, c] = [corner(a)?, corner(b)?, corner(c)?];
            Some(([a.0, b.0, c.0], [a.1, b.1, c.1]))
        })
        .collect()
}

/// Triangles that hang together: each leads to another one of its part, and the first of a part to itself.
struct Parts(Vec<usize>);

impl Parts {
    fn new(triangles: usize) -> Self {
        Self((0..triangles).collect())
    }

    /// The first triangle of a triangle's part.
    fn first(&mut self, mut triangle: usize) -> usize {
        while let Some(&next) = self.0.get(triangle).filter(|next| **next != triangle) {
            // Half the way for whoever comes after.
            let after = self.0.get(next).copied().unwrap_or(next);
            if let Some(slot) = self.0.get_mut(triangle) {
                *slot = after;
            }
            triangle = after;
        }
        triangle
    }

    fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.first(one), self.first(other));
        if let Some(slot) = self.0.get_mut(one.max(other)) {
            *slot = one.min(other);
        }
    }

    /// Whether each part has a volume above that of rounding, and not below 0, as one that is inside out.
    fn have_volumes(&mut self, triangles: &[Welded]) -> bool {
        let mut parts: HashMap<usize, Volume> = HashMap::new();
        for (index, (_, corners)) in triangles.iter().enumerate() {
            parts.entry(self.first(index)).or_insert_with(|| Volume::about(corners[0])).add(corners);
        }
        parts.values().all(Volume::is_proper)
    }
}

/// Six times the volume of a closed surface, summed over its triangles about one of its corners.
struct Volume {
    about: DVec3,
    min: DVec3,
    max: DVec3,
    six_fold: f64,
}

impl Volume {
    const fn about(corner: DVec3) -> Self {
        Self { about: corner, min: DVec3::ZERO, max: DVec3::ZERO, six_fold: 0.0 }
    }

    fn add(&mut self, corners: &[DVec3; 3]) {
        let [a, b, c] = corners.map(|corner| corner - self.about);
        self.six_fold += a.dot(b.cross(c));
        (self.min, self.max) = (self.min.min(a).min(b).min(c), self.max.max(a).max(b).max(c));
    }

    fn is_proper(&self) -> bool {
        self.six_fold > 6.0 * LEAST_VOLUME * (self.max - self.min).length().powi(3)
    }
}

#[cfg(test)]
mod tests {
    use trimaran_scene::Rgba8;

    use super::*;

    type Corners = Vec<[f32; 3]>;

    /// A box, its triangles counter-clockwise from outside.
    fn cuboid(at: [f32; 3], size: [f32; 3]) -> Corners {
        let corner = |i: usize| std::array::from_fn(|k| at[k] + if i >> k & 1 == 1 { size[k] } else { 0.0 });
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        faces.iter().flat_map(|&[a, b, c, d]| [a, b, c, c, d, a]).map(corner).collect()
    }

    /// Whether triangles are solid whose corners are given one after the other.
    fn solid(corners: &[[f32; 3]]) -> bool {
        let vertices: Vec<Vertex> =
            corners.iter().map(|&corner| Vertex::new(corner, Rgba8([0, 0, 0, 255]))).collect();
        is_solid(&vertices, &(0..corners.len() as u32).collect::<Vec<_>>())
    }

    fn turned(corners: &[[f32; 3]], triangle: usize) -> Corners {
        let mut corners = corners.to_vec();
        corners.swap(3 * triangle, 3 * triangle + 1);
        corners
    }

    const UNIT: [f32; 3] = [1.0; 3];

    #[test]
    fn boxes_rods_and_plates_are_solid_apart_or_touching() {
        let unit = || cuboid([0.0; 3], UNIT);
        assert!(solid(&unit()));
        assert!(solid(&cuboid([700.0, 0.0, -3.0], [100.0, 0.005, 0.005])));
        assert!(solid(&cuboid([0.0; 3], [30.0, 30.0, 0.001])));
        // Beside each other, with an edge in common, with a face in common, and one in the other.
        for (at, size) in
            [([5.0; 3], UNIT), ([1.0, 1.0, 0.0], UNIT), ([1.0, 0.0, 0.0], UNIT), ([0.2; 3], [0.5; 3])]
        {
            assert!(solid(&[unit(), cuboid(at, size)].concat()), "{at:?}");
        }
    }

    #[test]
    fn nothing_is_solid_that_lacks_a_triangle_or_has_one_turned_over() {
        let unit = cuboid([0.0; 3], UNIT);
        for triangle in 0..12 {
            let mut open = unit.clone();
            open.drain(3 * triangle..3 * triangle + 3);
            assert!(!solid(&open), "without {triangle}");
            assert!(!solid(&turned(&unit, triangle)), "{triangle} turned over");
        }
    }

    #[test]
    fn what_is_inside_out_or_flat_is_not_solid() {
        let inverted =
            |corners: Corners| (0..corners.len() / 3).fold(corners, |corners, i| turned(&corners, i));
        assert!(!solid(&inverted(cuboid([0.0; 3], UNIT))));
        // Beside a larger one that is not.
        let both = [cuboid([0.0; 3], [9.0; 3]), inverted(cuboid([20.0; 3], UNIT))].concat();
        assert!(!solid(&both));
        let sheet = [[0.1, 0.2, 0.3], [5.1, 0.7, 0.3], [0.4, 3.3, 9.3]];
        assert!(!solid(&[sheet, [sheet[1], sheet[0], sheet[2]]].concat()));
    }

    #[test]
    fn corners_are_the_same_where_their_positions_are() {
        let mut unit = cuboid([0.0; 3], UNIT);
        for zero in unit.iter_mut().step_by(2).flatten().filter(|x| **x == 0.0) {
            *zero = -0.0;
        }
        // And a triangle without area along an edge.
        unit.extend([[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
        assert!(solid(&unit));
        unit[0][0] = 1e-20;
        assert!(!solid(&unit));
    }

    #[test]
    fn an_index_without_a_vertex_or_no_triangle_is_no_solid_and_no_panic() {
        assert!(!is_solid(&[], &[0, 1, 2]));
        assert!(solid(&[])); // of nothing, nothing faces away
    }
}
