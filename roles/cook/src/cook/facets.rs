//! Pairs of triangles that make a flat convex quadrangle: the two halves of a box's face or of a pipe's long
//! strip.
//!
//! The distance to a convex set is a convex function. The larger the convex pieces of a surface, the sooner
//! its corners settle the bound over a triangle. Without pairs, a long strip would be cut wherever the
//! diagonal between its halves passes below.

use glam::Vec3;

use crate::lists::put;

/// The flatness tolerance of a pair, relative to the largest coordinate. The certificate's allowance for
/// rounding covers it.
pub(super) const FLATNESS: f32 = 5e-7;

/// A shared edge: its length squared and the two triangles.
#[derive(Debug, Clone, Copy)]
struct Bond {
    length: f32,
    triangles: [u32; 2],
}

/// For each triangle its partner, or itself. Longer shared edges pair first.
pub(super) fn pair_triangles(triangles: &[[Vec3; 3]]) -> Vec<u32> {
    let extent = triangles.iter().flatten().fold(0.0_f32, |m, p| m.max(p.abs().max_element()));
    let mut edges: Vec<(u64, u32)> = Vec::with_capacity(3 * triangles.len());
    for (index, &[a, b, c]) in (0_u32..).zip(triangles) {
        edges.extend([(a, b), (b, c), (c, a)].map(|(p, q)| (edge_key(p, q), index)));
    }
    edges.sort_unstable();
    let mut bonds: Vec<Bond> = edges
        .windows(2)
        .filter_map(|pair| match pair {
            [(k, s), (l, t)] if k == l => {
                let length =
                    flat_pair(triangles.get(*s as usize)?, triangles.get(*t as usize)?, FLATNESS * extent)?;
                Some(Bond { length, triangles: [*s, *t] })
            }
            _ => None,
        })
        .collect();
    bonds.sort_unstable_by(|x, y| y.length.total_cmp(&x.length).then(x.triangles.cmp(&y.triangles)));
    let mut partners: Vec<u32> = (0..triangles.len() as u32).collect();
    for Bond { triangles: [s, t], .. } in bonds {
        let free = |index: u32| partners.get(index as usize) == Some(&index);
        if s != t && free(s) && free(t) {
            for (from, to) in [(s, t), (t, s)] {
                put(&mut partners, from, to);
            }
        }
    }
    partners
}

/// The outline of two triangles that share an edge, in the winding of the first.
pub(super) fn quadrangle(first: &[Vec3; 3], second: &[Vec3; 3]) -> [Vec3; 4] {
    let [a, b, c] = *first;
    let shared = |p: &Vec3| second.contains(p);
    let apex = second.iter().copied().find(|p| !first.contains(p)).unwrap_or(a);
    // Rotated so that the shared edge is the first.
    let [p, q, r] = if !shared(&c) {
        [a, b, c]
    } else if !shared(&a) {
        [b, c, a]
    } else {
        [c, a, b]
    };
    [p, apex, q, r]
}

/// A key that is the same for an edge from either side. Other edges may share it, so the points are compared
/// later.
fn edge_key(p: Vec3, q: Vec3) -> u64 {
    let key = |v: Vec3| {
        // Adding zero turns -0 into 0.
        let [x, y, z] = (v + Vec3::ZERO).to_array().map(|c| u64::from(c.to_bits()));
        let mixed = (x ^ y.rotate_left(24) ^ z.rotate_left(48)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        // Multiplying alone is linear: the flipped signs of both ends may cancel, and mirrored edges tie.
        mixed ^ mixed >> 32
    };
    key(p).wrapping_add(key(q))
}

/// The squared length of the edge that two triangles share, if together they are flat and convex.
fn flat_pair(first: &[Vec3; 3], second: &[Vec3; 3], tolerance: f32) -> Option<f32> {
    let [a, b, c] = *first;
    let turned = [[a, b, c], [b, c, a], [c, a, b]];
    let ([p, q, r], s) = turned.into_iter().find_map(|[p, q, r]| {
        let others: [Vec3; 3] = *second;
        let apex = others.into_iter().find(|&v| v != p && v != q)?;
        (others.contains(&p) && others.contains(&q)).then_some(([p, q, r], apex))
    })?;
    let normal = (q - p).cross(r - p).try_normalize()?;
    let side = |from: Vec3, to: Vec3, point: Vec3| normal.dot((to - from).cross(point - from));
    let flat = normal.dot(s - p).abs() <= tolerance;
    let opposite = side(p, q, s) < 0.0;
    let (left, right) = (side(r, s, p), side(r, s, q));
    let convex = left.min(right) <= 0.0 && left.max(right) >= 0.0;
    (flat && opposite && convex).then(|| p.distance_squared(q))
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Vec3 = Vec3::ZERO;
    const B: Vec3 = Vec3::new(4.0, 0.0, 0.0);
    const C: Vec3 = Vec3::new(4.0, 1.0, 0.0);
    const D: Vec3 = Vec3::new(0.0, 1.0, 0.0);

    #[test]
    fn the_halves_of_a_rectangle_pair_whatever_their_winding() {
        assert_eq!(pair_triangles(&[[A, B, C], [A, C, D]]), [1, 0]);
        assert_eq!(pair_triangles(&[[A, B, C], [C, A, D]]), [1, 0]);
        assert_eq!(pair_triangles(&[[A, B, C], [D, C, A]]), [1, 0]);
    }

    #[test]
    fn flat_is_the_same_at_any_scale_and_place_and_zero_has_one_sign() {
        let bent = |bend: f32| D + Vec3::Z * bend;
        for scale in [1.0 / 1024.0, 1.0, 1024.0] {
            let pair = |bend: f32| {
                let place = |p: Vec3| (p + Vec3::new(1.0, 2.0, 3.0)) * scale;
                pair_triangles(&[[A, B, C].map(place), [A, C, bent(bend)].map(place)])
            };
            // The largest coordinate is 5, so the tolerance is 2.5e-6.
            assert_eq!((pair(1.9e-6), pair(3.8e-6)), (vec![1, 0], vec![0, 1]), "scale {scale}");
        }
        assert_eq!(pair_triangles(&[[A, B, C], [-A, C, D]]), [1, 0]);
    }

    #[test]
    fn the_rectangles_of_a_symmetric_model_all_find_their_other_halves() {
        let signs = [1.0, -1.0];
        let octants = signs.map(|x| signs.map(|y| signs.map(|z| Vec3::new(x, y, z)))).concat().concat();
        let places: Vec<Vec3> = octants.into_iter().flat_map(|octant| [octant, 2.0 * octant]).collect();
        for (low, high) in [(0.1, 0.3), (0.1, 0.7), (0.3, 0.4), (0.2, 0.9), (0.7, 1.3)] {
            let corners = [(low, low), (high, low), (high, high), (low, high)];
            let [a, b, c, d] = corners.map(|(x, y)| Vec3::new(x, y, 0.3));
            let halves = [[a, b, c], [a, c, d]].map(|half| places.iter().map(move |&p| half.map(|v| v * p)));
            let triangles: Vec<[Vec3; 3]> = halves.into_iter().flatten().collect();
            let partners: Vec<u32> = (16..32).chain(0..16).collect();
            assert_eq!(pair_triangles(&triangles), partners, "{low} to {high}");
        }
    }

    #[test]
    fn the_halves_of_a_triangle_pair_whichever_way_they_face() {
        // The shared edge ends in the middle of an edge of the whole.
        let [middle, apex] = [Vec3::ZERO, Vec3::new(1.0, 1.0, -2.0)];
        let [left, right] = [Vec3::new(-1.0, 1.0, 0.0), Vec3::new(1.0, -1.0, 0.0)];
        assert_eq!(pair_triangles(&[[apex, middle, left], [middle, apex, right]]), [1, 0]);
        assert_eq!(pair_triangles(&[[middle, apex, left], [apex, middle, right]]), [1, 0]);
    }

    #[test]
    fn bent_concave_and_folded_neighbours_do_not_pair() {
        let bent = D + Vec3::Z * 0.1;
        assert_eq!(pair_triangles(&[[A, B, C], [A, C, bent]]), [0, 1]);
        for (concave, scale) in [(-1.0, 1.0), (-0.001, 1.0), (-0.001, 1e-11)] {
            let shape = [[A, B, C], [A, C, Vec3::new(-8.0, concave, 0.0)]];
            let pair = pair_triangles(&shape.map(|triangle| triangle.map(|p| p * scale)));
            assert_eq!(pair, [0, 1], "{concave} at {scale}");
        }
        let folded = Vec3::new(2.0, 0.25, 0.0);
        assert_eq!(pair_triangles(&[[A, B, C], [A, C, folded]]), [0, 1]);
    }

    #[test]
    fn degenerate_triangles_stay_alone() {
        assert_eq!(pair_triangles(&[[A, A, B], [A, B, C], [A, B, B]]), [0, 1, 2]);
        assert_eq!(pair_triangles(&[[A, B, C], [C, C.midpoint(A), A]]), [0, 1]);
        assert!(pair_triangles(&[]).is_empty());
    }

    #[test]
    fn of_three_in_a_strip_the_longest_edge_pairs() {
        let e = Vec3::new(-1.0, 1.0, 0.0);
        assert_eq!(pair_triangles(&[[A, B, C], [A, C, D], [A, D, e]]), [1, 0, 2]);
    }
}
