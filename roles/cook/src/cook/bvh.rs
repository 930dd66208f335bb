//! The nearest point of a triangle mesh: a binary hierarchy of boxes over its triangles.
//!
//! Distances are computed in single precision to points that lie on a triangle by construction (clamped
//! barycentric coordinates). So the result is, up to the rounding of a few operations, never below the true
//! distance: a bound stays a bound even for slivers and degenerate triangles.

use glam::Vec3;

use super::facets;
use super::linear::bounds;
use crate::lists::{at, put};

/// Triangles per leaf: fewer enlarge the tree more than they help.
const LEAF: usize = 4;

#[derive(Debug, Clone, Copy)]
struct BoxNode {
    min: Vec3,
    /// For an inner node the index of the second child (the first follows its parent); for a leaf the first
    /// triangle.
    link: u32,
    max: Vec3,
    /// 0 for an inner node, else the number of triangles.
    count: u32,
}

/// A mesh for nearest-point queries.
#[derive(Debug)]
pub(super) struct Bvh {
    nodes: Vec<BoxNode>,
    /// The triangles, in the order of the leaves.
    triangles: Vec<[Vec3; 3]>,
    /// For each triangle the one that makes a flat convex quadrangle with it; itself if there is none.
    partners: Vec<u32>,
    /// The position of each triangle in the order of the leaves.
    places: Vec<u32>,
}

/// The nearest triangle found, and its distance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    pub(super) distance: f32,
    /// The triangle, for hints.
    pub(super) triangle: u32,
    /// The facet it belongs to, for [`Bvh::distance_to`].
    pub(super) facet: u32,
}

impl Bvh {
    /// Builds the hierarchy by halving along the longest side of the centroids' box.
    pub(super) fn new(positions: &[Vec3], indices: &[u32]) -> Self {
        let corner = |i: u32| at(positions, i);
        let mut ordered: Vec<Sorted> = (0_u32..)
            .zip(indices.as_chunks::<3>().0)
            .map(|(index, triangle)| {
                let corners @ [a, b, c] = triangle.map(corner);
                Sorted { corners, centre: a + b + c, index }
            })
            .collect();
        let mut nodes = Vec::with_capacity(ordered.len());
        if !ordered.is_empty() {
            build(&mut nodes, &mut ordered, 0);
        }
        let mut places = vec![0; ordered.len()];
        for (place, triangle) in (0_u32..).zip(&ordered) {
            put(&mut places, triangle.index, place);
        }
        let triangles: Vec<_> = ordered.into_iter().map(|triangle| triangle.corners).collect();
        let partners = facets::pair_triangles(&triangles);
        Self { nodes, triangles, partners, places }
    }

    /// The facet of each triangle, in the order in which they were given.
    pub(super) fn facets(&self) -> impl Iterator<Item = u32> {
        self.places.iter().map(|&place| place.min(self.partner(place)))
    }

    /// Walls on a facet's outline, perpendicular to it: a point on each and the unit vector inwards. None for
    /// a facet without area.
    pub(super) fn walls(&self, facet: u32) -> [Option<(Vec3, Vec3)>; 4] {
        let Some(&[a, b, c]) = self.triangles.get(facet as usize) else { return [None; 4] };
        let partner = self.partner(facet);
        let other = self.triangles.get(partner as usize).filter(|_| partner != facet);
        let outline = match other {
            Some(other) => facets::quadrangle(&[a, b, c], other),
            None => [a, b, c, a],
        };
        let [p, q, r, _] = outline;
        let Some(normal) = (q - p).cross(r - p).try_normalize() else { return [None; 4] };
        let [p, q, r, s] = outline;
        [(p, q), (q, r), (r, s), (s, p)]
            .map(|(from, to)| Some((from, normal.cross(to - from).try_normalize()?)))
    }

    /// The longest side of the box around a facet.
    pub(super) fn extent_of(&self, facet: u32) -> f32 {
        let corners = |t: u32| self.triangles.get(t as usize).into_iter().flatten();
        let (min, max) = bounds(corners(facet).chain(corners(self.partner(facet))).copied());
        (max - min).max_element()
    }

    /// The triangle nearest to `point`; `None` if there are none. `hint` is a triangle that may be near: it
    /// only saves time.
    pub(super) fn nearest(&self, point: Vec3, hint: u32) -> Option<Nearest> {
        let first = if (hint as usize) < self.triangles.len() { hint } else { 0 };
        let mut best = squared_distance(point, self.triangles.get(first as usize)?);
        let mut triangle = first;
        // Halving bounds the depth by 32; each level leaves one sibling behind.
        let mut stack = [(0.0_f32, 0_u32); 64];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (lower, index) = stack[height & 63];
            if lower >= best {
                continue;
            }
            let Some(node) = self.nodes.get(index as usize) else { continue };
            if node.count > 0 {
                let start = node.link as usize;
                let leaf = self.triangles.get(start..start + node.count as usize).unwrap_or_default();
                for (index, corners) in (node.link..).zip(leaf) {
                    let squared = squared_distance(point, corners);
                    if squared < best {
                        (best, triangle) = (squared, index);
                    }
                }
            } else {
                let (near, far) = (index + 1, node.link);
                let (near_distance, far_distance) =
                    (self.box_distance(near, point), self.box_distance(far, point));
                let ((d0, n0), (d1, n1)) = if far_distance < near_distance {
                    ((far_distance, far), (near_distance, near))
                } else {
                    ((near_distance, near), (far_distance, far))
                };
                for entry in [(d1, n1), (d0, n0)] {
                    if entry.0 < best {
                        stack[height & 63] = entry;
                        height += 1;
                    }
                }
            }
        }
        let facet = triangle.min(self.partner(triangle));
        Some(Nearest { distance: best.sqrt(), triangle, facet })
    }

    /// The distance from `point` to one facet: a triangle, or two that make a flat convex quadrangle.
    pub(super) fn distance_to(&self, facet: u32, point: Vec3) -> f32 {
        let squared =
            |t: u32| self.triangles.get(t as usize).map_or(f32::INFINITY, |t| squared_distance(point, t));
        let partner = self.partner(facet);
        let first = squared(facet);
        if partner == facet { first.sqrt() } else { first.min(squared(partner)).sqrt() }
    }

    fn partner(&self, triangle: u32) -> u32 {
        self.partners.get(triangle as usize).copied().unwrap_or(triangle)
    }

    fn box_distance(&self, node: u32, point: Vec3) -> f32 {
        self.nodes
            .get(node as usize)
            .map_or(f32::INFINITY, |node| (point - point.clamp(node.min, node.max)).length_squared())
    }
}

/// A triangle during sorting, with three times its centre, and its original index.
#[derive(Debug, Clone, Copy)]
struct Sorted {
    corners: [Vec3; 3],
    centre: Vec3,
    index: u32,
}

fn build(nodes: &mut Vec<BoxNode>, triangles: &mut [Sorted], first: u32) {
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for &Sorted { corners: [a, b, c], centre, .. } in triangles.iter() {
        min = min.min(a).min(b).min(c);
        max = max.max(a).max(b).max(c);
        low = low.min(centre);
        high = high.max(centre);
    }
    let index = nodes.len();
    nodes.push(BoxNode { min, link: first, max, count: triangles.len() as u32 });
    if triangles.len() <= LEAF {
        return;
    }
    let axis = (high - low).max_position();
    let middle = triangles.len() / 2;
    triangles.select_nth_unstable_by(middle, |s, t| s.centre[axis].total_cmp(&t.centre[axis]));
    let (left, right) = triangles.split_at_mut(middle);
    build(nodes, left, first);
    let second = nodes.len() as u32;
    build(nodes, right, first + middle as u32);
    if let Some(node) = nodes.get_mut(index) {
        (node.link, node.count) = (second, 0);
    }
}

/// The squared distance from `p` to a point of the triangle nearest to it (C. Ericson, "Real-Time Collision
/// Detection", 5.1.5: the regions of the corners, the edges, the inside).
fn squared_distance(p: Vec3, &[a, b, c]: &[Vec3; 3]) -> f32 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.length_squared();
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.length_squared();
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.length_squared();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (ap - ab * part(d1, d1 - d3)).length_squared();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (ap - ac * part(d2, d2 - d6)).length_squared();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return (bp - (c - b) * part(d4 - d3, (d4 - d3) + (d5 - d6))).length_squared();
    }
    let total = va + vb + vc;
    let (v, w) = (part(vb, total), part(vc, total));
    (ap - ab * v - ac * w.min(1.0 - v)).length_squared()
}

/// `a / b` as a barycentric coordinate: within 0 to 1, and 0 if rounding has left a zero divisor.
fn part(a: f32, b: f32) -> f32 {
    let quotient = a / b;
    if quotient > 0.0 { quotient.min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-1.0..1.0_f32).prop_map(Vec3::from_array)
    }

    /// The least distance to a dense grid of points on the triangle.
    fn sampled(p: Vec3, t: &[Vec3; 3]) -> f32 {
        let n = 60;
        let mut best = f32::INFINITY;
        for i in 0..=n {
            for j in 0..=n - i {
                let (u, v) = (i as f32 / n as f32, j as f32 / n as f32);
                best = best.min(p.distance(t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v));
            }
        }
        best
    }

    proptest! {
        #[test]
        fn the_distance_to_a_triangle_is_that_of_its_nearest_point(p in point(), a in point(), b in point(), c in point()) {
            let exact = squared_distance(p, &[a, b, c]).sqrt();
            let near = sampled(p, &[a, b, c]);
            prop_assert!(exact <= near + 1e-5, "{exact} above {near}");
            prop_assert!(exact >= near - 0.06, "{exact} far below {near}");
        }

        #[test]
        fn the_nearest_triangle_is_the_nearest_of_all(
            corners in prop::collection::vec(point(), 3..120), p in point(), hint in 0..200_u32
        ) {
            let count = corners.len() / 3 * 3;
            let indices: Vec<u32> = (0..count as u32).collect();
            let bvh = Bvh::new(&corners, &indices);
            let nearest = bvh.nearest(p, hint).unwrap();
            let brute = corners[..count].chunks(3)
                .map(|t| squared_distance(p, &[t[0], t[1], t[2]]).sqrt())
                .fold(f32::INFINITY, f32::min);
            prop_assert_eq!(nearest.distance, brute);
            prop_assert_eq!(bvh.distance_to(nearest.facet, p), brute);
        }
    }

    #[test]
    fn no_triangles_have_no_nearest() {
        assert!(Bvh::new(&[], &[]).nearest(Vec3::ZERO, 0).is_none());
    }

    #[test]
    fn degenerate_triangles_are_segments_and_points() {
        let line = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0];
        assert_eq!(squared_distance(Vec3::new(1.5, 2.0, 0.0), &line), 4.0);
        assert_eq!(squared_distance(Vec3::new(3.0, 0.0, 0.0), &line), 1.0);
        assert_eq!(squared_distance(Vec3::new(0.0, 3.0, 0.0), &[Vec3::ZERO; 3]), 9.0);
    }
}
