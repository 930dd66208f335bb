//! The shortest distance between two triangles, with a closest pair of points.

use glam::DVec3;

/// Corners in a frame, metres. A triangle may be degenerate: a segment, or a point.
pub(super) type Triangle = [DVec3; 3];

/// A pair of points, one on each surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    /// The squared distance between them.
    pub(super) square: f64,
    pub(super) points: [DVec3; 2],
}

/// The distance of touching triangles by rounding alone, as a share of their size.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// The closest points of two triangles. Triangles that intersect or touch are at distance 0, as are those
/// that are apart only by rounding.
///
/// The closest points are a corner and its foot on the other face, or points of two edges, or a point where
/// an edge passes through a face (Ericson, Real-Time Collision Detection, 5.1). Each candidate is a point of
/// either triangle, so rounding never makes the distance too short.
pub(super) fn closest(first: &Triangle, second: &Triangle) -> Pair {
    // From the first corner, so that far coordinates cost no digits.
    let from = first[0];
    let (a, b) = (first.map(|corner| corner - from), second.map(|corner| corner - from));
    let mut best = Pair { square: f64::INFINITY, points: [a[0], b[0]] };
    let mut offer = |[p, q]: [DVec3; 2]| {
        let square = p.distance_squared(q);
        if square < best.square {
            best = Pair { square, points: [p, q] };
        }
    };
    for edge in edges(&a) {
        passage(edge, &b).into_iter().for_each(&mut offer);
        for other in edges(&b) {
            between(edge, other).into_iter().for_each(&mut offer);
            offer([edge[0], nearest_on_segment(other, edge[0])]);
            offer([nearest_on_segment(edge, other[0]), other[0]]);
        }
    }
    for edge in edges(&b) {
        passage(edge, &a).into_iter().for_each(|[p, q]| offer([q, p]));
    }
    for corner in a {
        foot(corner, &b).into_iter().for_each(|on| offer([corner, on]));
    }
    for corner in b {
        foot(corner, &a).into_iter().for_each(|on| offer([on, corner]));
    }
    let size = a.iter().chain(&b).fold(0.0, |size: f64, corner| size.max(corner.abs().max_element()));
    if best.square <= (ROUNDING * size).powi(2) {
        best = Pair { square: 0.0, points: [best.points[0]; 2] };
    }
    Pair { points: best.points.map(|point| point + from), ..best }
}

fn edges(&[a, b, c]: &Triangle) -> [[DVec3; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// The point of a segment that is nearest to a point.
pub(super) fn nearest_on_segment([from, to]: [DVec3; 2], point: DVec3) -> DVec3 {
    let along = to - from;
    let square = along.length_squared();
    let share = if square > 0.0 { ((point - from).dot(along) / square).clamp(0.0, 1.0) } else { 0.0 };
    from + along * share
}

/// The point of a triangle straight below or above a point. `None` if that is beside the triangle, or the
/// triangle has no area.
fn foot(point: DVec3, &[a, b, c]: &Triangle) -> Option<DVec3> {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let normal = ab.cross(ac);
    let square = normal.length_squared();
    let (v, w) = (ap.cross(ac).dot(normal) / square, ab.cross(ap).dot(normal) / square);
    // Without an area they are NaN or infinite.
    (v >= 0.0 && w >= 0.0 && v + w <= 1.0).then(|| a + ab * v + ac * w)
}

/// Where a segment passes through a triangle: the point on either, which are the same but for rounding
/// (Möller and Trumbore 1997).
fn passage([from, to]: [DVec3; 2], &[a, b, c]: &Triangle) -> Option<[DVec3; 2]> {
    let (ab, ac, way, start) = (b - a, c - a, to - from, from - a);
    let across = way.cross(ac);
    let determinant = ab.dot(across);
    let beside = start.cross(ab);
    let (v, w) = (start.dot(across) / determinant, way.dot(beside) / determinant);
    let along = ac.dot(beside) / determinant;
    let is_within = v >= 0.0 && w >= 0.0 && v + w <= 1.0 && (0.0..=1.0).contains(&along);
    is_within.then(|| [from + way * along, a + ab * v + ac * w])
}

/// The closest points of the lines of two segments, if both lie on the segments. `None` for parallel ones.
///
/// By the cross product: the determinant of the usual equations would lose twice as many digits where the
/// segments are nearly parallel.
fn between([a, b]: [DVec3; 2], [c, d]: [DVec3; 2]) -> Option<[DVec3; 2]> {
    let (u, v, w) = (b - a, d - c, c - a);
    let normal = u.cross(v);
    let square = normal.length_squared();
    let (s, t) = (w.cross(v).dot(normal) / square, w.cross(u).dot(normal) / square);
    // Parallel ones make these NaN or infinite.
    let are_within = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
    are_within.then(|| [a + u * s, c + v * t])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// On the floor.
    const FLOOR: Triangle = [DVec3::ZERO, DVec3::X, DVec3::Z];

    fn at(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    fn moved(triangle: &Triangle, by: DVec3) -> Triangle {
        triangle.map(|corner| corner + by)
    }

    /// The distance, which is the same both ways, and that of the points.
    fn distance(a: &Triangle, b: &Triangle) -> f64 {
        let [there, back] = [closest(a, b), closest(b, a)];
        let (found, size) = (there.square.sqrt(), a[0].abs().max_element());
        assert!((found - back.square.sqrt()).abs() <= 1e-12, "{there:?} {back:?}");
        let apart = there.points[0].distance(there.points[1]);
        assert!((apart - found).abs() <= 1e-12 + 1e-15 * size, "{there:?}");
        found
    }

    #[test]
    fn a_corner_over_a_face_an_edge_over_an_edge_and_two_corners() {
        let above = [at(0.2, 3.0, 0.2), at(0.2, 5.0, 0.2), at(1.0, 5.0, 0.2)];
        assert_eq!(distance(&FLOOR, &above), 3.0);
        assert_eq!(closest(&FLOOR, &above).points, [at(0.2, 0.0, 0.2), above[0]]);
        // Across the long edge of the floor, a hand's breadth over it.
        let across = [at(0.0, 0.1, 0.0), at(1.0, 0.1, 1.0), at(0.5, 9.0, 0.5)];
        assert!((distance(&FLOOR, &across) - 0.1).abs() < 1e-15);
        let crossing = [at(0.4, 0.1, 0.4), at(2.0, 0.1, 2.0), at(1.0, 9.0, 1.0)];
        assert!((distance(&FLOOR, &crossing) - 0.1).abs() < 1e-15);
        let aside = moved(&FLOOR, at(4.0, 0.0, 0.0));
        assert_eq!(distance(&FLOOR, &aside), 3.0);
        assert_eq!(closest(&FLOOR, &aside).points, [DVec3::X, at(4.0, 0.0, 0.0)]);
    }

    #[test]
    fn a_triangle_through_another_touches_it_where_they_meet() {
        let through = [at(0.2, 1.0, 0.2), at(0.2, -1.0, 0.2), at(9.0, 0.0, 9.0)];
        let near = closest(&FLOOR, &through);
        assert_eq!(near.square, 0.0);
        assert!(near.points[0].distance(near.points[1]) < 1e-15 && near.points[0].y.abs() < 1e-15);
    }

    #[test]
    fn coplanar_triangles_overlap_touch_or_are_apart() {
        assert_eq!(distance(&FLOOR, &moved(&FLOOR, at(0.25, 0.0, 0.25))), 0.0, "they overlap");
        let inside = [at(0.1, 0.0, 0.1), at(0.2, 0.0, 0.1), at(0.1, 0.0, 0.2)];
        assert_eq!(distance(&FLOOR, &inside), 0.0, "one is within the other");
        assert_eq!(distance(&FLOOR, &FLOOR), 0.0, "they are the same");
        let beside = [at(1.0, 0.0, 1.0), at(2.0, 0.0, 1.0), at(2.0, 0.0, 2.0)];
        assert!((distance(&FLOOR, &beside) - 0.5_f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn triangles_that_share_a_corner_or_an_edge_touch() {
        let corner = [DVec3::X, at(2.0, 1.0, 0.0), at(2.0, -1.0, 0.3)];
        assert_eq!(distance(&FLOOR, &corner), 0.0);
        assert_eq!(closest(&FLOOR, &corner).points, [DVec3::X; 2]);
        let edge = [DVec3::X, DVec3::Z, at(1.0, 2.0, 1.0)];
        assert_eq!(distance(&FLOOR, &edge), 0.0);
    }

    #[test]
    fn degenerate_triangles_are_segments_and_points() {
        let point = [at(0.25, 2.0, 0.25); 3];
        assert_eq!(distance(&FLOOR, &point), 2.0);
        assert_eq!(distance(&point, &[at(0.25, 2.0, 3.25); 3]), 3.0);
        let segment = [at(0.25, 1.0, 0.25), at(0.25, -1.0, 0.25), at(0.25, 0.5, 0.25)];
        assert_eq!(distance(&FLOOR, &segment), 0.0);
        // Three corners on a line that is not along an axis, in the plane of the other triangle.
        let (along, tilted) = (at(0.3, 0.7, 0.1), [at(0.0, 0.0, 0.0), at(0.9, 2.1, 0.3), at(0.7, -0.3, 0.2)]);
        let beside = at(0.7, -0.3, 0.2) * -0.5;
        let line = [beside, beside + along * (1.0 / 3.0), beside + along];
        let apart = (0..=1000).map(|step| {
            let point = beside + along * (f64::from(step) / 1000.0);
            let edges = edges(&tilted).map(|edge| nearest_on_segment(edge, point).distance(point));
            edges.into_iter().fold(f64::INFINITY, f64::min)
        });
        let apart = apart.fold(f64::INFINITY, f64::min);
        assert!(apart > 0.1 && (distance(&tilted, &line) - apart).abs() < 1e-6);
    }

    #[test]
    fn far_from_the_origin_the_distance_is_as_exact_as_the_coordinates() {
        let far = at(1e7, -2e7, 3e7);
        let near = [at(0.25, 0.005, 0.25), at(1.25, 1.0, 0.25), at(0.25, 1.0, 1.25)];
        let found = distance(&moved(&FLOOR, far), &moved(&near, far));
        // A coordinate of 3e7 m is a multiple of 3.7 nm.
        assert!((found - 0.005).abs() < 4e-9, "{found}");
        let touching = [DVec3::X, at(2.0, 1.0, 0.0), at(2.0, -1.0, 0.3)];
        assert_eq!(distance(&moved(&FLOOR, far), &moved(&touching, far)), 0.0);
    }

    #[test]
    fn nearly_parallel_edges_are_as_far_apart_as_they_are() {
        for turn in [1e-3, 1e-6, 1e-9, 1e-12] {
            // Two long thin triangles, whose edges cross 1 mm apart at their middles.
            let a = [at(-10.0, 0.0, 0.0), at(10.0, 0.0, 0.0), at(0.0, -5.0, 0.0)];
            let b = [at(-10.0, 1e-3, -10.0 * turn), at(10.0, 1e-3, 10.0 * turn), at(0.0, 5.0, 0.0)];
            assert!((distance(&a, &b) - 1e-3).abs() < 1e-15, "{turn}: {}", distance(&a, &b));
        }
    }

    fn point() -> impl Strategy<Value = DVec3> {
        // Many on a lattice, so that corners and edges meet, and triangles lie in one plane or are
        // degenerate.
        let lattice = prop::array::uniform3(-2_i32..=2).prop_map(|at| DVec3::from_array(at.map(f64::from)));
        prop_oneof![lattice, prop::array::uniform3(-2.0..2.0_f64).prop_map(DVec3::from_array)]
    }

    fn triangle() -> impl Strategy<Value = Triangle> {
        prop::array::uniform3(point())
    }

    /// The distance of a convex function's minimum by descent: alternating projections between two convex
    /// sets converge to a closest pair (Cheney and Goldstein 1959). It shares no code with the above.
    fn by_projections(a: &Triangle, b: &Triangle) -> f64 {
        let mut on = (a[0] + a[1] + a[2]) / 3.0;
        for _ in 0..20_000 {
            on = project(project(on, b), a);
        }
        on.distance(project(on, b))
    }

    /// The nearest point of a triangle, by the least of all its barycentric regions.
    fn project(point: DVec3, &[a, b, c]: &Triangle) -> DVec3 {
        let (ab, ac, ap) = (b - a, c - a, point - a);
        let (d00, d01, d11) = (ab.dot(ab), ab.dot(ac), ac.dot(ac));
        let (d20, d21) = (ap.dot(ab), ap.dot(ac));
        let area = d00 * d11 - d01 * d01;
        let (v, w) = ((d11 * d20 - d01 * d21) / area, (d00 * d21 - d01 * d20) / area);
        let inner = (area > 1e-12 && v >= 0.0 && w >= 0.0 && v + w <= 1.0).then(|| a + ab * v + ac * w);
        let on_edge = |p: DVec3, q: DVec3| {
            let way = q - p;
            let share = (point - p).dot(way) / way.length_squared().max(1e-300);
            p + way * share.clamp(0.0, 1.0)
        };
        let all = [on_edge(a, b), on_edge(b, c), on_edge(c, a)].into_iter().chain(inner);
        all.min_by(|p, q| p.distance_squared(point).total_cmp(&q.distance_squared(point))).unwrap()
    }

    proptest! {
        #[test]
        fn the_distance_is_that_of_two_convex_sets(a in triangle(), b in triangle()) {
            let found = distance(&a, &b);
            let expected = by_projections(&a, &b);
            prop_assert!(found <= expected + 1e-12, "{} is more than {}", found, expected);
            // The projections end early where the triangles nearly touch at a small angle.
            prop_assert!(found >= expected - 1e-2, "{} is less than {}", found, expected);
        }

        #[test]
        fn no_pair_of_points_is_nearer(
            a in triangle(), b in triangle(),
            shares in prop::collection::vec(prop::array::uniform4(0.0..1.0_f64), 60)
        ) {
            let within = |[p, q, r]: &Triangle, v: f64, w: f64| {
                let (v, w) = if v + w > 1.0 { (1.0 - v, 1.0 - w) } else { (v, w) };
                *p + (q - p) * v + (r - p) * w
            };
            let found = distance(&a, &b);
            for [s, t, u, v] in shares {
                let sample = within(&a, s, t).distance(within(&b, u, v));
                prop_assert!(found <= sample + 1e-12);
            }
        }

        #[test]
        fn the_points_are_of_the_triangles(a in triangle(), b in triangle(), far in point()) {
            let far = far * 1e6;
            let (a, b) = (moved(&a, far), moved(&b, far));
            let near = closest(&a, &b);
            for (point, triangle) in near.points.iter().zip([&a, &b]) {
                prop_assert!(project(*point, triangle).distance(*point) < 1e-8);
            }
        }
    }
}
