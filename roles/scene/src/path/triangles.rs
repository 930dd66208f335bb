//! The triangles of one mesh in a box tree, with a walker's distance queries.

use glam::{DVec3, Vec3};

/// Corners of a triangle in a mesh's local frame.
pub(super) type Triangle = [Vec3; 3];

/// A mesh's triangles under a binary tree of boxes, in the mesh's local frame.
#[derive(Debug)]
pub(super) struct Triangles {
    triangles: Vec<Triangle>,
    branches: Vec<Branch>,
}

/// A box over triangles, or over two branches.
#[derive(Debug)]
struct Branch {
    min: Vec3,
    max: Vec3,
    /// First triangle, or the first of two branches that stand side by side.
    first: u32,
    /// The number of triangles; 0 for a branch over branches.
    count: u32,
}

impl Triangles {
    const PER_LEAF: usize = 6;

    pub(super) fn new(mut triangles: Vec<Triangle>) -> Self {
        let mut branches = Vec::with_capacity(triangles.len() / 2 + 1);
        branches.push(Branch::over(&triangles, 0));
        let mut next = 0;
        while next < branches.len() {
            let Branch { min, max, first, count } = branches[next];
            if count as usize > Self::PER_LEAF {
                let axis = (max - min).max_position();
                let (first, count) = (first as usize, count as usize);
                let half = count / 2;
                let range = &mut triangles[first..first + count];
                range.select_nth_unstable_by(half, |a, b| centre(a, axis).total_cmp(&centre(b, axis)));
                let children = branches.len() as u32;
                let low = Branch::over(&range[..half], first);
                let high = Branch::over(&range[half..], first + half);
                branches.extend([low, high]);
                branches[next].first = children;
                branches[next].count = 0;
            }
            next += 1;
        }
        Self { triangles, branches }
    }

    /// Calls `visit` with each triangle whose branch's box passes `touches` (lower corner, upper corner).
    pub(super) fn visit(
        &self,
        mut touches: impl FnMut(Vec3, Vec3) -> bool,
        mut visit: impl FnMut(&Triangle),
    ) {
        let mut stack = vec![0_u32];
        while let Some(branch) = stack.pop().map(|index| &self.branches[index as usize]) {
            if !touches(branch.min, branch.max) {
                continue;
            }
            if branch.count == 0 && !self.triangles.is_empty() {
                stack.extend([branch.first, branch.first + 1]);
            } else {
                let first = branch.first as usize;
                self.triangles[first..first + branch.count as usize].iter().for_each(&mut visit);
            }
        }
    }
}

impl Branch {
    fn over(triangles: &[Triangle], first: usize) -> Self {
        let corners = triangles.iter().flatten();
        let (min, max) = corners.fold((Vec3::MAX, Vec3::MIN), |(min, max), &p| (min.min(p), max.max(p)));
        Self { min, max, first: first as u32, count: triangles.len() as u32 }
    }
}

fn centre(triangle: &Triangle, axis: usize) -> f32 {
    triangle.iter().map(|corner| corner[axis]).sum()
}

/// Where the line `origin + t direction` passes a box, as a range of t; empty (low above high) if it does
/// not.
pub(super) fn ray_box(origin: DVec3, inverse: DVec3, min: DVec3, max: DVec3) -> (f64, f64) {
    let (a, b) = ((min - origin) * inverse, (max - origin) * inverse);
    // If the line lies in a face, zero times infinity is NaN: then that axis does not limit the line at all.
    let undecided = (a + b).is_nan_mask();
    let near = DVec3::select(undecided, DVec3::NEG_INFINITY, a.min(b));
    let far = DVec3::select(undecided, DVec3::INFINITY, a.max(b));
    (near.x.max(near.y).max(near.z), far.x.min(far.y).min(far.z))
}

/// The hit of a ray on a triangle, from either side, in lengths of `direction` (Moeller and Trumbore 1997).
pub(super) fn ray_triangle(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let from_a = origin - a;
    let u = from_a.dot(p) / determinant;
    let q = from_a.cross(ab);
    let v = direction.dot(q) / determinant;
    let t = ac.dot(q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then_some(t)
}

/// The distance between a segment and a triangle; 0 where they meet.
pub(super) fn segment_triangle(from: DVec3, to: DVec3, corners: [DVec3; 3]) -> f64 {
    if ray_triangle(from, to - from, corners).is_some_and(|t| t <= 1.0) {
        return 0.0;
    }
    let [a, b, c] = corners;
    let ends = point_triangle(from, corners).min(point_triangle(to, corners));
    [(a, b), (b, c), (c, a)].iter().fold(ends, |least, &(p, q)| least.min(segment_segment(from, to, p, q)))
}

/// The distance from a point to a triangle.
fn point_triangle(point: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let inside = |p: DVec3, q: DVec3| (q - p).cross(point - p).dot(normal) >= 0.0;
    if normal != DVec3::ZERO && inside(a, b) && inside(b, c) && inside(c, a) {
        return ((point - a).dot(normal) / normal.length()).abs();
    }
    point_segment(point, a, b).min(point_segment(point, b, c)).min(point_segment(point, c, a))
}

fn point_segment(point: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = b - a;
    let length = along.length_squared();
    let t = if length > 0.0 { ((point - a).dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
    point.distance(a + along * t)
}

/// The distance between two segments: either they come closest between their ends, or at an end of one of
/// them.
fn segment_segment(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    let (u, v, w) = (b - a, d - c, a - c);
    let (uu, uv, vv, uw, vw) = (u.dot(u), u.dot(v), v.dot(v), u.dot(w), v.dot(w));
    let determinant = uu * vv - uv * uv;
    let ends = point_segment(a, c, d)
        .min(point_segment(b, c, d))
        .min(point_segment(c, a, b))
        .min(point_segment(d, a, b));
    if determinant <= 0.0 {
        return ends;
    }
    let (s, t) = ((uv * vw - vv * uw) / determinant, (uu * vw - uv * uw) / determinant);
    if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
        ends.min((a + u * s).distance(c + v * t))
    } else {
        ends
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FLOOR: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Z];

    #[test]
    fn distances_to_face_edge_and_corner() {
        let at = |x, y, z| point_triangle(DVec3::new(x, y, z), FLOOR);
        assert_eq!(at(0.2, 3.0, 0.2), 3.0);
        assert_eq!(at(0.5, 0.0, -2.0), 2.0);
        assert_eq!(at(4.0, 4.0, 0.0), 5.0);
    }

    #[test]
    fn a_segment_through_a_triangle_touches_it() {
        assert_eq!(segment_triangle(DVec3::new(0.2, 1.0, 0.2), DVec3::new(0.2, -1.0, 0.2), FLOOR), 0.0);
        assert_eq!(segment_triangle(DVec3::new(0.2, 3.0, 0.2), DVec3::new(0.2, 1.0, 0.2), FLOOR), 1.0);
    }

    #[test]
    fn degenerate_triangles_are_points_and_lines() {
        let point = [DVec3::ONE; 3];
        assert_eq!(segment_triangle(DVec3::ZERO, DVec3::X, point), 2_f64.sqrt());
        let line = [DVec3::ZERO, DVec3::X * 2.0, DVec3::X];
        assert_eq!(point_triangle(DVec3::new(1.0, 0.5, 0.0), line), 0.5);
    }

    #[test]
    fn a_ray_in_a_face_of_a_box_meets_it() {
        for x in [0.0, 1.0] {
            let (near, far) = ray_box(DVec3::new(x, 3.0, 0.5), DVec3::NEG_Y.recip(), DVec3::ZERO, DVec3::ONE);
            assert_eq!((near, far), (2.0, 3.0));
        }
        let (near, far) = ray_box(DVec3::new(1.5, 3.0, 0.5), DVec3::NEG_Y.recip(), DVec3::ZERO, DVec3::ONE);
        assert!(near > far);
    }

    #[test]
    fn an_empty_mesh_has_no_triangles() {
        Triangles::new(Vec::new()).visit(|_, _| true, |_| panic!("there is none"));
    }

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-2.0f64..2.0).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn no_sample_is_nearer_than_the_distance(
            from in point(), to in point(), corners in prop::array::uniform3(point()),
            samples in prop::collection::vec((0.0f64..1.0, 0.0f64..1.0, 0.0f64..1.0), 40)
        ) {
            let distance = segment_triangle(from, to, corners);
            let [a, b, c] = corners;
            for (t, u, v) in samples {
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let sample = (a + (b - a) * u + (c - a) * v).distance(from.lerp(to, t));
                prop_assert!(sample >= distance - 1e-9, "{sample} < {distance}");
            }
        }

        #[test]
        fn the_tree_visits_all_that_touch(centres in prop::collection::vec(point(), 0..80), probe in point()) {
            let triangles: Vec<Triangle> = centres
                .iter().map(|c| [c.as_vec3(), c.as_vec3() + Vec3::X * 0.1, c.as_vec3() + Vec3::Y * 0.1]).collect();
            let probe = probe.as_vec3();
            let near = |t: &Triangle| t[0].distance(probe) < 0.5;
            let mut found = 0;
            Triangles::new(triangles.clone()).visit(
                |min, max| probe.clamp(min, max).distance(probe) < 0.5,
                |t| found += usize::from(near(t)),
            );
            prop_assert_eq!(found, triangles.iter().filter(|t| near(t)).count());
        }
    }
}
