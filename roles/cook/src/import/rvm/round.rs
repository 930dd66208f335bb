//! Doubly curved surfaces: tori and ellipsoids.
//!
//! Both directions share the tolerance, and each may use what the other leaves. All of these surfaces are
//! rings about z, with facets between two rings. From the true surface to a facet there are two steps: from
//! the arc between the rings to its chord, along the surface's normal; then from the circles to their chords,
//! towards the axis. Of the second step only the part along the normal leads to the facet, the rest slides
//! along it. So the error is the first sagitta plus the second times the cosine between the normal and the
//! direction away from the axis. If a surface faces its axis that cosine is negative: the two steps lead to
//! opposite sides, and the error is the larger of them.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;

use super::solid::{Chord, MOST_CHORDS, Ring, Solid, circle, direction};

/// A torus whose angle is this near to a full turn is closed.
const FULL_TURN: f64 = TAU - 1e-4;

/// A circle of `radius` whose centre is `offset` from z, swept about z by `angle`.
pub(super) fn torus(solid: &mut Solid, offset: f64, radius: f64, angle: f64, chord: Chord) {
    let fewest = chord.count(offset.abs() + radius.abs(), angle);
    // Beyond twice the fewest, hardly any tolerance is left for the circle.
    let best = (fewest..=MOST_CHORDS.min(2 * fewest + 1))
        .filter_map(|chords| {
            let half = angle.abs().min(TAU) / chords as f64 / 2.0;
            let section =
                Section { offset: offset.abs(), radius: radius.abs(), sweep: 1.0 - libm::cos(half) };
            Some((chords, section.count(chord.tolerance)?, section))
        })
        .min_by_key(|&(chords, count, _)| chords * count);
    let (chords, angles) = match best {
        Some((chords, count, section)) => (chords, section.angles(count, chord.tolerance)),
        // Too large for the tolerance: as fine as allowed.
        None => (fewest, even(chord.count(radius, TAU)).collect()),
    };
    // Angles count from the circle's farthest point from the axis.
    let radius = radius.abs().copysign(offset);
    let section: Vec<_> = angles
        .into_iter()
        .map(|at| {
            let (cos, sin) = direction(at);
            (offset + radius * cos, radius * sin)
        })
        .collect();
    turn(solid, &section, chords, angle);
}

fn even(count: usize) -> impl Iterator<Item = f64> {
    (0..count).map(move |step| TAU * step as f64 / count as f64)
}

/// The circle of a torus, cut into chords that are shorter where the torus faces away from its axis. Angles
/// count from there.
#[derive(Debug, Clone, Copy)]
struct Section {
    offset: f64,
    radius: f64,
    /// The sagitta of the turn's chords at a distance of 1 from the axis.
    sweep: f64,
}

impl Section {
    /// The largest angle of a chord that begins at `at` and leads away from the outermost point.
    fn step(&self, at: f64, tolerance: f64) -> f64 {
        // Both factors fall along the chord, so the tolerance left at its beginning is left along all of it.
        let cos = libm::cos(at).max(0.0);
        let left = tolerance - (self.offset + self.radius * cos) * self.sweep * cos;
        let half = libm::acos((1.0 - left.max(0.0) / self.radius).clamp(-1.0, 1.0));
        (2.0 * half).min(PI / 3.0)
    }

    /// The angles of the corners from the outermost point to the innermost, and the length of the next chord.
    fn half(&self, tolerance: f64) -> impl Iterator<Item = (f64, f64)> {
        let corner = move |at: f64| (at, self.step(at, tolerance));
        std::iter::successors(Some(corner(0.0)), move |&(at, step)| Some(corner(at + step)))
            .take(MOST_CHORDS / 2)
    }

    /// The fewest chords of the whole circle; `None` if that exceeds the limit. If the number is odd, one
    /// chord lies across the innermost point.
    fn count(&self, tolerance: f64) -> Option<usize> {
        (0..).zip(self.half(tolerance)).find_map(|(pairs, (at, step))| {
            let across = || (at + step / 2.0 >= PI).then_some(2 * pairs + 1);
            if at >= PI { Some(2 * pairs) } else { across() }
        })
    }

    /// The corners' angles for this many chords, which suffice: with the smallest tolerance for which they
    /// do.
    fn angles(&self, count: usize, tolerance: f64) -> Vec<f64> {
        let (mut low, mut high) = (0.0, tolerance);
        for _ in 0..40 {
            let middle = low + (high - low) / 2.0;
            if self.count(middle).is_some_and(|needed| needed <= count) {
                high = middle;
            } else {
                low = middle;
            }
        }
        let there: Vec<f64> = self.half(high).map(|(at, _)| at.min(PI)).take(count / 2 + 1).collect();
        let back = there.iter().skip(1).take((count - 1) / 2).rev().map(|at| TAU - at);
        there.iter().copied().chain(back).collect()
    }
}

/// A sphere about the origin.
pub(super) fn sphere(solid: &mut Solid, radius: f64, chord: Chord) {
    Ellipsoid { radius, height: radius, centre: 0.0 }.top(solid, PI, chord);
}

/// Half an ellipsoid on the xy plane.
pub(super) fn dish(solid: &mut Solid, radius: f64, height: f64, chord: Chord) {
    Ellipsoid { radius, height, centre: 0.0 }.top(solid, FRAC_PI_2, chord);
}

/// The part of a sphere above the xy plane that is `height` high and `radius` wide at its foot.
pub(super) fn spherical_dish(solid: &mut Solid, radius: f64, height: f64, chord: Chord) {
    let sphere = (radius * radius + height * height) / (2.0 * height);
    if sphere.is_finite() {
        let whole = Ellipsoid { radius: sphere, height: sphere, centre: height - sphere };
        // From the top to the foot; more than a quarter turn if the dish bulges.
        whole.top(solid, libm::atan2(radius, sphere - height), chord);
    } else {
        dish(solid, radius, height, chord);
    }
}

/// An ellipsoid of revolution about z with these half axes: a unit sphere, stretched. Rings are given by the
/// angle from the top on that sphere.
#[derive(Debug, Clone, Copy)]
struct Ellipsoid {
    radius: f64,
    height: f64,
    /// Its centre on z.
    centre: f64,
}

impl Ellipsoid {
    /// The part within the angle `arc` of the top, closed at its foot.
    fn top(&self, solid: &mut Solid, arc: f64, chord: Chord) {
        let fewest = chord.count(self.radius.abs().max(self.height.abs()), arc).max(2);
        let counts = (fewest..=MOST_CHORDS.min(2 * fewest + 1))
            .map(|rows| self.counts(arc, rows, chord))
            .min_by_key(|counts| counts.iter().sum::<usize>())
            .unwrap_or_default();
        let whole = arc >= PI - 1e-6;
        let rows = counts.len() as f64;
        let mut rings = (1..).zip(counts).collect::<Vec<_>>();
        if whole {
            rings.pop(); // the foot is a point
        }
        let mut lower: Option<Ring> = None;
        for (row, count) in rings.into_iter().rev() {
            let upper = self.ring(solid, arc * f64::from(row) / rows, count);
            match lower {
                Some(lower) => solid.wall(&lower, &upper),
                None if whole => {
                    let bottom = solid.vertex(DVec3::Z * (self.centre - self.height));
                    solid.cone_from(bottom, &upper);
                }
                None => solid.begin(&upper),
            }
            lower = Some(upper);
        }
        if let Some(lower) = lower {
            let top = solid.vertex(DVec3::Z * (self.centre + self.height));
            solid.cone_to(&lower, top);
        }
    }

    fn ring(&self, solid: &mut Solid, angle: f64, count: usize) -> Ring {
        let (cos, sin) = direction(angle);
        let (radius, z) = (self.radius * sin, self.centre + self.height * cos);
        solid.ring(circle(count).map(|(x, y)| DVec3::new(radius * x, radius * y, z)))
    }

    /// The corners that each ring needs, from the top down, with this many rows.
    fn counts(&self, arc: f64, rows: usize, chord: Chord) -> Vec<usize> {
        let row_height = arc / rows as f64;
        let row = 1.0 - libm::cos(row_height / 2.0);
        let ring = |index: usize| {
            let angle = row_height * index as f64;
            // Of the rows above and below, the one nearer to the equator needs more.
            let below = angle + row_height / 2.0;
            let sin = if (angle - row_height / 2.0..=below).contains(&FRAC_PI_2) {
                1.0
            } else {
                libm::sin(angle - row_height / 2.0).max(libm::sin(below))
            };
            let reach =
                self.reach(angle - row_height).max(self.reach(angle)).max(self.reach(angle + row_height));
            let left = Chord { tolerance: (chord.tolerance - reach * row).max(0.0) };
            let count = left.count(reach * sin * sin, TAU);
            // The foot is an edge: along it nothing slides.
            if index == rows { count.max(chord.count(self.radius * libm::sin(arc), TAU)) } else { count }
        };
        (1..=rows).map(ring).collect()
    }

    /// The distance of the tangent plane at an angle from the top from the centre: it scales a sagitta of the
    /// unit sphere, along the normal.
    fn reach(&self, angle: f64) -> f64 {
        let (cos, sin) = direction(angle);
        let [across, along] = [self.height * sin, self.radius * cos];
        (self.radius * self.height).abs() / (across * across + along * along).sqrt()
    }
}

/// Sweeps a section, (distance from z, height) counter-clockwise, about z from the x axis on.
pub(super) fn turn(solid: &mut Solid, section: &[(f64, f64)], count: usize, angle: f64) {
    let closed = angle.abs() >= FULL_TURN;
    // Three chords at least, or a full turn would be flat.
    let (count, angle) = if closed { (count.max(3), TAU.copysign(angle)) } else { (count, angle) };
    // Seen from the end of a positive sweep, the section runs clockwise.
    let mut section = section.to_vec();
    if angle >= 0.0 {
        section.reverse();
    }
    let rings: Vec<Ring> = (0..count + usize::from(!closed))
        .map(|step| {
            let (cos, sin) = direction(angle * step as f64 / count as f64);
            solid.ring(section.iter().map(|&(radius, z)| DVec3::new(radius * cos, radius * sin, z)))
        })
        .collect();
    for pair in rings.windows(2) {
        if let [lower, upper] = pair {
            solid.wall(lower, upper);
        }
    }
    if let (Some(first), Some(last)) = (rings.first(), rings.last()) {
        if closed {
            solid.wall(last, first);
        } else {
            solid.begin(first);
            solid.end(last);
        }
    }
    // A section that touches the axis collapses there.
    if section.iter().any(|&(radius, _)| radius == 0.0) {
        solid.collapse();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tessellate::tests::assert_closed;
    use super::*;

    const TOLERANCE: f64 = 1.0;
    const CHORD: Chord = Chord { tolerance: TOLERANCE };

    fn triangles(solid: &Solid) -> impl Iterator<Item = [DVec3; 3]> {
        let at = |index: u32| solid.positions[index as usize];
        solid.indices.as_chunks::<3>().0.iter().map(move |triangle| triangle.map(at))
    }

    fn distance_to(solid: &Solid, point: DVec3) -> f64 {
        triangles(solid).map(|[a, b, c]| distance(point, a, b, c)).fold(f64::MAX, f64::min)
    }

    fn torus_of(offset: f64, radius: f64, angle: f64) -> Solid {
        let mut solid = Solid::default();
        torus(&mut solid, offset, radius, angle, CHORD);
        solid
    }

    proptest! {
        /// Points of the true torus are within the tolerance of the triangles, by brute force.
        #[test]
        fn a_torus_keeps_the_tolerance(
            u in 0.0..1.0, v in 0.0..TAU, radius in 1.0..40.0, offset in 41.0..100.0, angle in 0.1..TAU
        ) {
            let solid = torus_of(offset, radius, angle);
            assert_closed(&solid);
            let (cos, sin) = direction(u * angle);
            let out = offset + radius * v.cos();
            let point = DVec3::new(out * cos, out * sin, radius * v.sin());
            let off = distance_to(&solid, point);
            prop_assert!(off <= TOLERANCE + 1e-9, "{off}");
        }

        #[test]
        fn a_sphere_keeps_the_tolerance(u in 0.0..TAU, v in 0.0..PI, radius in 2.0..300.0) {
            let mut solid = Solid::default();
            sphere(&mut solid, radius, CHORD);
            assert_closed(&solid);
            let off = distance_to(&solid, on_ellipsoid(u, v, radius, radius));
            prop_assert!(off <= TOLERANCE + 1e-9, "{off}");
        }

        #[test]
        fn a_dish_keeps_the_tolerance(
            u in 0.0..TAU, v in 0.0..FRAC_PI_2, radius in 2.0..300.0, height in 2.0..300.0
        ) {
            let mut solid = Solid::default();
            dish(&mut solid, radius, height, CHORD);
            assert_closed(&solid);
            let off = distance_to(&solid, on_ellipsoid(u, v, radius, height));
            prop_assert!(off <= TOLERANCE + 1e-9, "{off}");
        }
    }

    fn on_ellipsoid(u: f64, v: f64, radius: f64, height: f64) -> DVec3 {
        DVec3::new(radius * u.cos() * v.sin(), radius * u.sin() * v.sin(), height * v.cos())
    }

    /// With half the tolerance for each direction, an elbow would have 594 triangles. With all of it for
    /// each, 284, but with up to twice the allowed error.
    #[test]
    fn what_one_way_leaves_the_other_uses() {
        let elbow = torus_of(150.0, 50.0, FRAC_PI_2);
        assert_eq!(elbow.indices.len() / 3, 416);
    }

    #[test]
    fn the_circle_is_finer_where_it_faces_away_from_the_axis() {
        let section = Section { offset: 150.0, radius: 50.0, sweep: 2e-3 };
        let count = section.count(TOLERANCE).unwrap();
        let angles = section.angles(count, TOLERANCE);
        assert_eq!(angles.len(), count);
        let steps: Vec<f64> =
            angles.iter().zip(angles.iter().skip(1).chain([&TAU])).map(|(from, to)| to - from).collect();
        assert!(steps.iter().all(|&step| step > 0.0));
        assert!(steps[0] < 0.8 * steps[count / 2], "{steps:?}");
        assert!(steps.iter().zip(steps.iter().rev()).all(|(a, b)| (a - b).abs() < 1e-6), "{steps:?}");
    }

    /// The distance from `p` to the triangle: to its plane if `p` projects to the inside, else to an edge.
    fn distance(p: DVec3, a: DVec3, b: DVec3, c: DVec3) -> f64 {
        let normal = (b - a).cross(c - a);
        let inside = |a: DVec3, b: DVec3| normal.dot((b - a).cross(p - a)) >= 0.0;
        if inside(a, b) && inside(b, c) && inside(c, a) {
            return (p - a).dot(normal).abs() / normal.length();
        }
        let edge = |a: DVec3, b: DVec3| {
            let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            p.distance(a.lerp(b, along))
        };
        edge(a, b).min(edge(b, c)).min(edge(c, a))
    }
}
