//! Tessellates primitives.
//!
//! Every solid is closed, its vertices shared, its faces outward; ends that touch another primitive are
//! capped as well. No point of the true surface is farther from the triangles than the chord tolerance or, on
//! a large one, a ten-thousandth of its size.

use std::f64::consts::TAU;

use glam::DVec3;

use super::round;
use super::shape::{Polygon, Shape};
use super::solid::{Chord, Ring, Solid, circle};
use crate::import::polygon::Triangulator;

/// The shape's surface, cut to `chord`.
pub(super) fn tessellate(shape: &Shape, chord: Chord) -> Solid {
    let mut solid = Solid::default();
    match *shape {
        Shape::Pyramid { bottom, top, offset, height } => pyramid(&mut solid, bottom, top, offset, height),
        Shape::Box { size: [x, y, z] } => pyramid(&mut solid, [x, y], [x, y], [0.0; 2], z),
        Shape::RectangularTorus { inner, outer, height, angle } => {
            let section = [(inner, -0.5), (outer, -0.5), (outer, 0.5), (inner, 0.5)];
            let section = section.map(|(radius, z)| (radius, z * height));
            round::turn(&mut solid, &section, chord.count(outer, angle), angle);
        }
        Shape::CircularTorus { offset, radius, angle } => {
            round::torus(&mut solid, offset, radius, angle, chord);
        }
        Shape::EllipticalDish { radius, height } => round::dish(&mut solid, radius, height, chord),
        Shape::SphericalDish { radius, height } => round::spherical_dish(&mut solid, radius, height, chord),
        Shape::Snout { bottom, top, height, offset: [x, y], bottom_shear, top_shear } => {
            let low = End { radius: bottom, centre: DVec3::new(-x, -y, -height) / 2.0, shear: bottom_shear };
            let high = End { radius: top, centre: DVec3::new(x, y, height) / 2.0, shear: top_shear };
            frustum(&mut solid, &low, &high, chord);
        }
        Shape::Cylinder { radius, height } => {
            let end = |z| End { radius, centre: DVec3::Z * z, shear: [0.0; 2] };
            frustum(&mut solid, &end(-height / 2.0), &end(height / 2.0), chord);
        }
        Shape::Sphere { diameter } => round::sphere(&mut solid, diameter / 2.0, chord),
        Shape::Line => {}
        Shape::FacetGroup { ref polygons, .. } => facets(&mut solid, polygons),
    }
    solid
}

fn pyramid(solid: &mut Solid, bottom: [f64; 2], top: [f64; 2], offset: [f64; 2], height: f64) {
    let mut rectangle = |[x, y]: [f64; 2], side: f64| {
        let centre = DVec3::new(offset[0], offset[1], height) * side;
        let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)];
        solid.ring(corners.map(|(i, j)| centre + DVec3::new(i * x, j * y, 0.0)))
    };
    let (low, high) = (rectangle(bottom, -0.5), rectangle(top, 0.5));
    solid.wall(&low, &high);
    solid.begin(&low);
    solid.end(&high);
    solid.collapse();
}

/// One end of a frustum: a circle, cut at angles about y and x.
struct End {
    radius: f64,
    centre: DVec3,
    shear: [f64; 2],
}

impl End {
    /// The end's rise along x and y.
    fn slope(&self) -> [f64; 2] {
        self.shear.map(libm::tan)
    }

    /// The longest half axis of the elliptic cut.
    fn reach(&self) -> f64 {
        let [x, y] = self.slope();
        self.radius.abs() * (1.0 + x * x + y * y).sqrt()
    }

    fn ring(&self, solid: &mut Solid, count: usize) -> Ring {
        let [slope_x, slope_y] = self.slope();
        solid.ring(circle(count).map(|(cos, sin)| {
            let (x, y) = (self.radius * cos, self.radius * sin);
            self.centre + DVec3::new(x, y, slope_x * x + slope_y * y)
        }))
    }
}

fn frustum(solid: &mut Solid, low: &End, high: &End, chord: Chord) {
    let count = chord.count(low.reach().max(high.reach()), TAU);
    match (low.radius == 0.0, high.radius == 0.0) {
        (false, true) => {
            let ring = low.ring(solid, count);
            let tip = solid.vertex(high.centre);
            solid.cone_to(&ring, tip);
            solid.begin(&ring);
        }
        (true, false) => {
            let tip = solid.vertex(low.centre);
            let ring = high.ring(solid, count);
            solid.cone_from(tip, &ring);
            solid.end(&ring);
        }
        _ => {
            let (lower, upper) = (low.ring(solid, count), high.ring(solid, count));
            solid.wall(&lower, &upper);
            solid.begin(&lower);
            solid.end(&upper);
        }
    }
}

/// Polygons, with corners at the same position shared.
fn facets(solid: &mut Solid, polygons: &[Polygon]) {
    let mut triangulator = Triangulator::default();
    for polygon in polygons {
        let first = solid.positions.len() as u32;
        solid.positions.extend(polygon.iter().flatten());
        for triangle in triangulator.triangulate(polygon) {
            solid.triangle(triangle.map(|corner| first + corner));
        }
    }
    solid.large_polygons += triangulator.large_polygons();
    solid.collapse();
}

#[cfg(test)]
pub(super) mod tests {
    use std::collections::HashMap;
    use std::f64::consts::{FRAC_PI_2, PI};

    use glam::DVec3;

    use super::*;

    fn volume(solid: &Solid) -> f64 {
        let at = |index: u32| solid.positions[index as usize];
        let triangles = solid.indices.as_chunks::<3>().0.iter();
        triangles.map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum()
    }

    /// Every edge is used once in each direction: the surface is closed, shares its vertices, and winds one
    /// way.
    pub(in super::super) fn assert_closed(solid: &Solid) {
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for &[a, b, c] in solid.indices.as_chunks::<3>().0 {
            for edge in [(a, b), (b, c), (c, a)] {
                assert_ne!(edge.0, edge.1);
                *edges.entry(edge).or_default() += 1;
            }
        }
        for (&(a, b), &count) in &edges {
            assert_eq!((count, edges.get(&(b, a))), (1, Some(&1)), "edge {a} {b}");
        }
    }

    fn check(shape: &Shape, expected: f64) {
        let solid = tessellate(shape, Chord { tolerance: 0.005 });
        assert_closed(&solid);
        let volume = volume(&solid);
        assert!((volume / expected - 1.0).abs() < 0.01, "{shape:?} has the volume {volume}, not {expected}");
    }

    #[test]
    fn solids_are_closed_and_enclose_their_volume() {
        check(&Shape::Box { size: [1.0, 2.0, 3.0] }, 6.0);
        check(&Shape::Cylinder { radius: 2.0, height: 3.0 }, 12.0 * PI);
        check(&Shape::Sphere { diameter: 4.0 }, 32.0 / 3.0 * PI);
        check(&Shape::EllipticalDish { radius: 3.0, height: 2.0 }, 12.0 * PI);
        check(&Shape::SphericalDish { radius: 3.0, height: 1.0 }, PI / 6.0 * 28.0);
        check(&Shape::SphericalDish { radius: 3.0, height: 4.0 }, PI * 4.0 / 6.0 * (27.0 + 16.0));
        check(&Shape::CircularTorus { offset: 5.0, radius: 2.0, angle: TAU }, 40.0 * PI * PI);
        check(&Shape::CircularTorus { offset: 5.0, radius: 2.0, angle: FRAC_PI_2 }, 10.0 * PI * PI);
        let torus = |inner| Shape::RectangularTorus { inner, outer: 3.0, height: 2.0, angle: PI };
        check(&torus(1.0), 8.0 * PI);
        check(&torus(0.0), 9.0 * PI);
    }

    #[test]
    fn pyramids_may_taper_to_an_edge_or_a_tip() {
        let pyramid = |top| Shape::Pyramid { bottom: [2.0, 3.0], top, offset: [0.5, -0.5], height: 6.0 };
        check(&pyramid([0.0, 0.0]), 12.0);
        check(&pyramid([0.0, 3.0]), 18.0);
        check(&pyramid([1.0, 1.0]), 6.0 * (6.0 + 1.0 + 2.5) / 3.0);
    }

    #[test]
    fn snouts_may_lean_taper_to_either_end_and_be_cut_askew() {
        let snout = |bottom, top, offset, bottom_shear, top_shear| Shape::Snout {
            bottom,
            top,
            height: 3.0,
            offset,
            bottom_shear,
            top_shear,
        };
        let leaning = |bottom, top| snout(bottom, top, [1.0, -2.0], [0.0; 2], [0.0; 2]);
        let cone = |b: f64, t: f64| PI * (b * b + b * t + t * t);
        check(&leaning(2.0, 1.0), cone(2.0, 1.0));
        check(&leaning(2.0, 0.0), cone(2.0, 0.0));
        check(&leaning(0.0, 2.0), cone(0.0, 2.0));
        check(&snout(2.0, 2.0, [0.0; 2], [0.1, 0.2], [-0.3, 0.2]), 12.0 * PI);
    }

    #[test]
    fn a_snout_is_where_its_offsets_and_cuts_put_it() {
        let shape = Shape::Snout {
            bottom: 1.0,
            top: 2.0,
            height: 10.0,
            offset: [4.0, 0.0],
            bottom_shear: [0.0, 0.0],
            top_shear: [PI / 4.0, 0.0],
        };
        let solid = tessellate(&shape, Chord { tolerance: 0.01 });
        let has = |p: DVec3| solid.positions.iter().any(|&q| q.distance(p) < 1e-12);
        assert!(has(DVec3::new(-2.0 + 1.0, 0.0, -5.0)));
        assert!(has(DVec3::new(2.0 + 2.0, 0.0, 5.0 + 2.0)));
    }

    #[test]
    fn flat_shapes_do_not_break() {
        for shape in [
            Shape::Cylinder { radius: 0.0, height: 50.0 },
            Shape::Box { size: [0.0, 0.0, 0.0] },
            Shape::SphericalDish { radius: 3.0, height: 0.0 },
            Shape::EllipticalDish { radius: 0.0, height: 0.0 },
            Shape::CircularTorus { offset: 0.0, radius: 0.0, angle: 0.0 },
            Shape::RectangularTorus { inner: 0.0, outer: 0.0, height: 0.0, angle: -1.0 },
        ] {
            let solid = tessellate(&shape, Chord { tolerance: 0.01 });
            assert!(solid.positions.iter().all(|p| p.is_finite()), "{shape:?}");
        }
    }
}
