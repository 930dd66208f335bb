//! The certificate against dense sampling, on random and on named meshes.

use glam::Vec3;
use proptest::prelude::*;
use trimaran_cook::hausdorff_bound;

type Triangles = Vec<[Vec3; 3]>;

fn bound(a: &Triangles, b: &Triangles) -> f32 {
    let (a, b) = (a.concat(), b.concat());
    let count = |mesh: &[Vec3]| (0..mesh.len() as u32).collect::<Vec<u32>>();
    hausdorff_bound((&a, &count(&a)), (&b, &count(&b)))
}

/// Points on the triangles, on a grid of `n` steps along each edge.
fn samples(mesh: &Triangles, n: usize) -> Vec<Vec3> {
    let grid = |t: &[Vec3; 3]| {
        let [a, b, c] = *t;
        (0..=n)
            .flat_map(move |i| {
                (0..=n - i).map(move |j| a + ((b - a) * i as f32 + (c - a) * j as f32) / n as f32)
            })
            .collect::<Vec<_>>()
    };
    mesh.iter().flat_map(grid).collect()
}

/// The largest distance of a sample of `a` from the samples of `b`: below the true distance by at most the
/// spacing of `a`, above it by that of `b`.
fn one_sided(a: &Triangles, b: &Triangles, n: usize) -> f32 {
    let to = samples(b, n);
    let nearest = |p: Vec3| to.iter().map(|q| p.distance_squared(*q)).fold(f32::INFINITY, f32::min).sqrt();
    samples(a, n).into_iter().map(nearest).fold(0.0, f32::max)
}

fn two_sided(a: &Triangles, b: &Triangles, n: usize) -> f32 {
    one_sided(a, b, n).max(one_sided(b, a, n))
}

fn longest_edge(mesh: &Triangles) -> f32 {
    mesh.iter().flat_map(|[a, b, c]| [a.distance(*b), b.distance(*c), c.distance(*a)]).fold(0.0, f32::max)
}

fn mesh(most: usize) -> impl Strategy<Value = Triangles> {
    let point = || prop::array::uniform3(-1.0..1.0_f32).prop_map(Vec3::from_array);
    prop::collection::vec(prop::array::uniform3(point()), 1..most)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_bound_is_never_below_what_sampling_finds(a in mesh(5), b in mesh(5)) {
        let n = 24;
        let spacing = longest_edge(&a).max(longest_edge(&b)) / n as f32;
        let (bound, sampled) = (bound(&a, &b), two_sided(&a, &b, n));
        // Sampling the other mesh overestimates distances by at most the spacing.
        prop_assert!(bound >= sampled - spacing, "bound {bound}, sampled {sampled}");
        prop_assert!(bound <= 1.05 * (sampled + spacing) + 1e-4, "bound {bound}, sampled {sampled}");
    }

    #[test]
    fn the_bound_is_the_same_from_either_side_up_to_its_gap(a in mesh(6), b in mesh(6)) {
        let (ab, ba) = (bound(&a, &b), bound(&b, &a));
        prop_assert!(ab <= 1.051 * ba && ba <= 1.051 * ab, "{ab} and {ba}");
    }
}

fn square(z: f32, size: f32) -> Triangles {
    let [a, b, c, d] = [(0.0, 0.0), (size, 0.0), (size, size), (0.0, size)].map(|(x, y)| Vec3::new(x, y, z));
    vec![[a, b, c], [a, c, d]]
}

#[test]
fn parallel_squares_are_their_distance_apart() {
    for size in [1.0, 1.0 / 1024.0, 1024.0] {
        let bound = bound(&square(0.0, size), &square(0.25 * size, size));
        assert!((0.25..=0.25 * 1.05).contains(&(bound / size)), "{bound} at {size}");
    }
}

#[test]
fn beyond_the_work_limit_the_bound_is_looser_but_no_smaller() {
    // Thin blades with points along one edge. Midway between two points, both are half a unit away.
    let [near, limited] = [10, 100].map(|length: u16| {
        let v = |x: u16, y: f32| Vec3::new(x.into(), y, 0.0);
        let blades = (0..4).map(|i| [v(i * length, 0.0), v((i + 1) * length, 0.0), v(i * length, 0.01)]);
        let points = (0..4 * length).map(|x| [v(x, 0.0) + Vec3::X * 0.5; 3]);
        bound(&blades.collect(), &points.collect())
    });
    assert!((0.5..=0.5 * 1.051).contains(&near), "{near}");
    assert!(limited > 0.5 * 1.06, "{limited}");
}

#[test]
fn the_same_surface_cut_otherwise_is_no_distance_apart() {
    let [a, b, c, d] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
    let other = vec![[a, b, d], [b, c, d]];
    let bound = bound(&square(0.0, 1.0), &other);
    assert!(bound < 3e-4, "{bound}");
}

#[test]
fn a_component_that_vanished_counts_with_its_distance() {
    let mut whole = square(0.0, 1.0);
    whole.extend(square(0.0, 0.1).iter().map(|t| t.map(|p| p + Vec3::new(0.0, 0.0, 7.0))));
    let bound = bound(&whole, &square(0.0, 1.0));
    assert!((7.0..=7.0 * 1.05).contains(&bound), "{bound}");
}

#[test]
fn a_hole_is_seen_although_all_corners_stay() {
    // Four strips around a hole of half the square's width: its middle is a quarter from the rim.
    let full = square(0.0, 4.0);
    let v = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    let strip = |x0, y0, x1, y1| vec![[v(x0, y0), v(x1, y0), v(x1, y1)], [v(x0, y0), v(x1, y1), v(x0, y1)]];
    let rim: Triangles = [
        strip(0.0, 0.0, 4.0, 1.0),
        strip(0.0, 3.0, 4.0, 4.0),
        strip(0.0, 1.0, 1.0, 3.0),
        strip(3.0, 1.0, 4.0, 3.0),
    ]
    .concat();
    let bound = bound(&full, &rim);
    assert!((1.0..=1.05).contains(&bound), "{bound}");
}

#[test]
fn empty_single_and_degenerate_meshes() {
    let empty = Triangles::new();
    let point = vec![[Vec3::ONE; 3]];
    let line = vec![[Vec3::ZERO, Vec3::X, Vec3::X * 2.0]];
    assert_eq!(bound(&empty, &empty), 0.0);
    assert_eq!(bound(&empty, &point), f32::INFINITY);
    assert_eq!(bound(&point, &empty), f32::INFINITY);
    assert!(bound(&point, &point) < 1e-4);
    let from_point_to_line = bound(&point, &line);
    let farthest = Vec3::ONE.distance(Vec3::ZERO);
    assert!((farthest..=farthest * 1.06).contains(&from_point_to_line), "{from_point_to_line}");
}

#[test]
fn values_that_are_not_finite_end_without_a_panic() {
    let broken = vec![[Vec3::NAN, Vec3::X, Vec3::Y], [Vec3::INFINITY, Vec3::X, Vec3::Y]];
    let _ = bound(&broken, &square(0.0, 1.0));
    let _ = bound(&square(0.0, 1.0), &broken);
}
