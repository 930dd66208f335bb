//! Triangulates plane polygons with holes.
//!
//! A polygon's contours come in any order and direction. Holes follow from nesting: a contour within an odd
//! number of others is a hole, so an island in a hole is drawn.

use std::collections::HashSet;

use earcut::Earcut;
use glam::{DVec2, DVec3};

/// Polygons with more corners than this are not cut exactly. Nesting takes time quadratic in the contours,
/// and cutting quadratic in the corners if they cross: a second for this many, a day for a million.
const MOST_CORNERS: usize = 8_192;

/// Triangulates polygons; reuses its memory.
pub(super) struct Triangulator {
    earcut: Earcut<f64>,
    large_polygons: u64,
}

/// A contour projected to 2D.
struct Contour {
    points: Vec<DVec2>,
    /// Number of its first corner among those of all contours.
    first: u32,
    /// Twice the area; positive if it winds like the polygon.
    area: f64,
    /// How many contours contain it.
    depth: usize,
    /// Index of the smallest contour that contains it.
    parent: Option<usize>,
}

impl Default for Triangulator {
    fn default() -> Self {
        Self { earcut: Earcut::new(), large_polygons: 0 }
    }
}

impl Triangulator {
    /// How many polygons had too many corners to be cut exactly.
    pub(super) const fn large_polygons(&self) -> u64 {
        self.large_polygons
    }

    /// Adds the triangles of a face without holes, whose corners are numbers of `places`.
    pub(super) fn face(&mut self, face: &[u32], places: &[DVec3], indices: &mut Vec<u32>) {
        if face.len() == 3 {
            indices.extend_from_slice(face);
            return;
        }
        let corners = face.iter().filter_map(|&corner| places.get(corner as usize).copied()).collect();
        for triangle in self.triangulate(&[corners]) {
            indices.extend(triangle.into_iter().filter_map(|corner| face.get(corner as usize)));
        }
    }

    /// The triangles of a polygon, facing as its largest contour winds. Corners are numbered through all
    /// contours, in the order given. Corners must be finite.
    pub(super) fn triangulate(&mut self, polygon: &[Vec<DVec3>]) -> Vec<[u32; 3]> {
        if let [contour] = polygon
            && contour.len() == 3
        {
            return vec![[0, 1, 2]];
        }
        let Some((origin, normal)) = plane(polygon) else { return crossed(polygon) };
        let (x, y) = normal.any_orthonormal_pair();
        let mut first = 0;
        let mut contours = Vec::new();
        for corners in polygon {
            let flat = |p: &DVec3| DVec2::new((p - origin).dot(x), (p - origin).dot(y));
            let points: Vec<DVec2> = corners.iter().map(flat).collect();
            if points.len() >= 3 {
                contours.push(Contour { area: area(&points), points, first, depth: 0, parent: None });
            }
            first += corners.len() as u32;
        }
        let mut triangles = Vec::new();
        if contours.iter().map(|contour| contour.points.len()).sum::<usize>() > MOST_CORNERS {
            // An overfilled polygon is better than a hole in a wall.
            self.large_polygons += 1;
            for contour in &contours {
                self.fill(contour, &[], &mut triangles);
            }
            return triangles;
        }
        contours.sort_by(|a, b| b.area.abs().total_cmp(&a.area.abs()));
        nest(&mut contours);
        for (index, outer) in contours.iter().enumerate().filter(|(_, contour)| contour.depth % 2 == 0) {
            let is_hole = |contour: &&Contour| contour.parent == Some(index) && contour.depth % 2 == 1;
            let holes: Vec<&Contour> = contours.iter().filter(is_hole).collect();
            self.fill(outer, &holes, &mut triangles);
        }
        triangles
    }

    fn fill(&mut self, outer: &Contour, holes: &[&Contour], triangles: &mut Vec<[u32; 3]>) {
        let rings = || std::iter::once(outer).chain(holes.iter().copied());
        let points: Vec<DVec2> = rings().flat_map(|contour| contour.points.iter().copied()).collect();
        let numbers: Vec<u32> =
            rings().flat_map(|contour| (contour.first..).take(contour.points.len())).collect();
        let starts: Vec<u32> = rings()
            .scan(0, |end, contour| {
                *end += contour.points.len() as u32;
                Some(*end)
            })
            .take(holes.len())
            .collect();
        let mut corners: Vec<u32> = Vec::new();
        if points.len() <= MOST_CORNERS {
            self.earcut.earcut(points.iter().map(|point| point.to_array()), &starts, &mut corners);
        }

        let twice = |&[a, b, c]: &[u32; 3]| match [a, b, c].map(|corner| points.get(corner as usize)) {
            [Some(a), Some(b), Some(c)] => (b - a).perp_dot(c - a),
            _ => 0.0,
        };
        let wanted = outer.area.abs() - holes.iter().map(|hole| hole.area.abs()).sum::<f64>();
        let covered: f64 = corners.as_chunks::<3>().0.iter().map(|triangle| twice(triangle).abs()).sum();
        if covered < 0.999 * wanted {
            // A contour crosses itself or a hole: an overfilled polygon is better than a hole in a wall.
            corners = cover(outer.points.len() as u32);
        }
        for triangle in corners.as_chunks::<3>().0 {
            let [a, b, c] = *triangle;
            let turned = if (twice(triangle) < 0.0) == (outer.area < 0.0) { [a, b, c] } else { [a, c, b] };
            if let [Some(&a), Some(&b), Some(&c)] = turned.map(|corner| numbers.get(corner as usize)) {
                triangles.push([a, b, c]);
            }
        }
    }
}

/// Triangles that cover everything inside a contour of this many corners, holes too: every other corner is
/// cut off, repeatedly, so that few triangles meet at any. In a fan all would meet at one, and simplifying
/// them would take quadratic time.
fn cover(corners: u32) -> Vec<u32> {
    let mut triangles = Vec::new();
    let mut ring: Vec<u32> = (0..corners).collect();
    while ring.len() > 2 {
        triangles.extend(ring.windows(3).step_by(2).flatten());
        if let ([first, .., before, last], true) = (&*ring, ring.len().is_multiple_of(2)) {
            triangles.extend([before, last, first]);
        }
        ring = ring.into_iter().step_by(2).collect();
    }
    triangles
}

/// Triangles of a polygon whose signed areas cancel. A bow tie encloses as much one way as the other: an
/// overfilled polygon is better than a hole in a wall. A contour that retraces its own path has no surface.
fn crossed(polygon: &[Vec<DVec3>]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    let mut first = 0;
    for corners in polygon {
        let places: HashSet<[u64; 3]> = corners.iter().map(|p| p.to_array().map(f64::to_bits)).collect();
        if places.len() == corners.len() && spread(corners) > 0.0 {
            let covered = cover(corners.len() as u32);
            triangles.extend(
                covered.as_chunks::<3>().0.iter().map(|corners| corners.map(|corner| first + corner)),
            );
        }
        first += corners.len() as u32;
    }
    triangles
}

/// Twice the area of the largest triangle with the first corner and the one farthest from it.
fn spread(corners: &[DVec3]) -> f64 {
    let Some(&origin) = corners.first() else { return 0.0 };
    let from_first = || corners.iter().map(|corner| corner - origin);
    let far = from_first().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    from_first().map(|corner| corner.cross(far.unwrap_or_default()).length()).fold(0.0, f64::max)
}

/// A point and the normal of the contour with the largest area (Newell's sum); none if all are flat, or their
/// areas cancel.
fn plane(polygon: &[Vec<DVec3>]) -> Option<(DVec3, DVec3)> {
    let normals = polygon.iter().filter_map(|contour| {
        let origin = *contour.first()?;
        let ends = contour.iter().zip(contour.iter().skip(1));
        let sum: DVec3 = ends.map(|(&a, &b)| (a - origin).cross(b - origin)).sum();
        Some((contour, origin, sum))
    });
    let (contour, origin, sum) =
        normals.max_by(|(.., a), (.., b)| a.length_squared().total_cmp(&b.length_squared()))?;
    // A sum that is only rounding has no direction.
    let has_area = sum.length() > 1e-9 * spread(contour);
    Some((origin, sum.try_normalize().filter(|_| has_area)?))
}

/// Twice the signed area.
fn area(points: &[DVec2]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum()
}

/// Determines the nesting of contours sorted from large to small.
fn nest(contours: &mut [Contour]) {
    for index in 1..contours.len() {
        let (larger, rest) = contours.split_at_mut(index);
        let Some(contour) = rest.first_mut() else { continue };
        let around = larger.iter().enumerate().rev().find(|(_, outer)| outer.surrounds(contour));
        if let Some((parent, outer)) = around {
            contour.parent = Some(parent);
            contour.depth = outer.depth + 1;
        }
    }
}

impl Contour {
    /// Whether most corners of `other` are inside: a hole may touch the border.
    fn surrounds(&self, other: &Self) -> bool {
        let inside = other.points.iter().filter(|&&point| self.contains(point)).count();
        2 * inside > other.points.len()
    }

    /// Whether a ray from the point crosses the contour an odd number of times.
    fn contains(&self, p: DVec2) -> bool {
        let next = self.points.iter().cycle().skip(1);
        let crossings = self.points.iter().zip(next).filter(|&(a, b)| {
            (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
        });
        crossings.count() % 2 == 1
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A square of half side `half` about the middle, in the plane x = 7.
    fn square(half: f64) -> Vec<DVec3> {
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(y, z)| DVec3::new(7.0, y * half, z * half))
            .to_vec()
    }

    fn backwards(mut contour: Vec<DVec3>) -> Vec<DVec3> {
        contour.reverse();
        contour
    }

    /// The sum of the triangles' area vectors, and of their lengths.
    fn areas(polygon: Vec<Vec<DVec3>>) -> (DVec3, f64) {
        let corners = polygon.concat();
        let triangles = Triangulator::default().triangulate(&polygon);
        let halves = triangles.into_iter().map(|triangle| {
            let [a, b, c] = triangle.map(|corner| corners[corner as usize]);
            (b - a).cross(c - a) / 2.0
        });
        halves.fold((DVec3::ZERO, 0.0), |(sum, length), half| (sum + half, length + half.length()))
    }

    fn assert_area(polygon: Vec<Vec<DVec3>>, expected: f64) {
        let (sum, length) = areas(polygon);
        assert!((sum.x - expected).abs() < 1e-9, "{sum} is not {expected}");
        assert!((length - expected).abs() < 1e-9, "{length} is not {expected}: triangles overlap");
    }

    #[test]
    fn holes_wind_either_way_and_come_in_any_order() {
        assert_area(vec![square(2.0), square(1.0)], 12.0);
        assert_area(vec![square(2.0), backwards(square(1.0))], 12.0);
        assert_area(vec![backwards(square(1.0)), square(2.0)], 12.0);
    }

    #[test]
    fn an_island_in_a_hole_is_drawn() {
        assert_area(vec![square(3.0), square(2.0), square(1.0)], 36.0 - 16.0 + 4.0);
    }

    #[test]
    fn contours_side_by_side_are_both_drawn() {
        let aside = square(1.0).into_iter().map(|p| p + DVec3::Y * 5.0).collect();
        assert_area(vec![square(2.0), aside], 16.0 + 4.0);
    }

    #[test]
    fn a_concave_polygon_keeps_its_notch_and_its_side() {
        let mut notched = square(1.0);
        notched.push(DVec3::new(7.0, 0.0, 0.0));
        assert_area(vec![notched.clone()], 3.0);
        let (sum, _) = areas(vec![backwards(notched)]);
        assert!((sum.x + 3.0).abs() < 1e-9);
    }

    #[test]
    fn a_polygon_that_crosses_itself_is_covered() {
        let bow =
            vec![square(1.0)[0], square(1.0)[2], square(1.0)[1], square(1.0)[3], DVec3::new(7.0, -3.0, 0.0)];
        assert!(areas(vec![bow]).1 > 1.0);
    }

    /// The areas cancel, exactly or except for rounding.
    #[test]
    fn a_bow_tie_is_covered_and_a_way_there_and_back_is_not() {
        for scale in [1.0, 0.1, 1e-5] {
            let [a, b, c, d]: [DVec3; 4] = square(scale).try_into().unwrap();
            assert!(areas(vec![vec![a, c, b, d]]).1 > 3.0 * scale * scale, "{scale}");
            assert_eq!(areas(vec![vec![a, b, c, b]]).1, 0.0);
        }
    }

    /// Squares within squares, a hundred thousand of them: in quadratic time this would take hours.
    #[test]
    fn very_many_contours_are_filled_and_counted() {
        let polygon: Vec<_> = (1..=100_000).map(|half| square(f64::from(half))).collect();
        let mut triangulator = Triangulator::default();
        let triangles = triangulator.triangulate(&polygon);
        assert_eq!((triangles.len(), triangulator.large_polygons()), (200_000, 1));
        let largest = [399_996, 399_997, 399_998, 399_999];
        let covering =
            triangles.iter().filter(|triangle| triangle.iter().all(|corner| largest.contains(corner)));
        assert_eq!(covering.count(), 2);
    }

    /// Each corner is opposite to the last one, so that all sides cross: cutting this exactly would take
    /// days.
    #[test]
    fn a_contour_of_very_many_corners_that_cross_is_covered() {
        let corners = 1_000_000;
        let star = (0..corners).map(|i| {
            let (sin, cos) = (f64::from(i) * 2.399_963).sin_cos();
            DVec3::new(7.0, cos, sin)
        });
        let mut triangulator = Triangulator::default();
        let triangles = triangulator.triangulate(&[star.collect()]);
        assert_eq!(triangles.len(), corners as usize - 2);
        assert_eq!(triangulator.large_polygons(), 1);
    }

    #[test]
    fn a_cover_has_all_sides_once_and_few_triangles_at_a_corner() {
        for corners in 3..70 {
            let triangles = cover(corners);
            assert_eq!(triangles.len() as u32, 3 * (corners - 2));
            let mut sides: Vec<[u32; 2]> = Vec::new();
            for &[a, b, c] in triangles.as_chunks::<3>().0 {
                sides.extend([[a, b], [b, c], [c, a]]);
            }
            // Inner edges have a twin in the other direction.
            let outside: Vec<_> = sides.iter().filter(|[a, b]| !sides.contains(&[*b, *a])).collect();
            assert_eq!(outside.len() as u32, corners);
            assert!(outside.iter().all(|[a, b]| *b == (a + 1) % corners), "{corners}: {outside:?}");
            let most = (0..corners).map(|corner| triangles.iter().filter(|at| **at == corner).count()).max();
            assert!(most.unwrap() <= 14, "{corners}: {most:?}");
        }
    }

    #[test]
    fn a_polygon_of_very_few_corners_less_is_cut_well() {
        let holes = (MOST_CORNERS - 4) / 4;
        let hole = |number: usize| {
            let aside = DVec3::new(0.0, (number % 64) as f64 - 31.5, (number / 64) as f64 - 31.5);
            square(0.25).into_iter().map(|corner| corner + aside + DVec3::X * 0.0).collect()
        };
        let polygon: Vec<_> = std::iter::once(square(40.0)).chain((0..holes).map(hole)).collect();
        assert_area(polygon, 80.0 * 80.0 - holes as f64 * 0.25);
    }

    #[test]
    fn degenerate_polygons_vanish() {
        for polygon in [vec![], vec![vec![]], vec![square(0.0)], vec![square(1.0)[..2].to_vec()]] {
            assert_eq!(areas(polygon).1, 0.0);
        }
    }

    proptest! {
        #[test]
        fn no_contours_break_it(
            polygon in prop::collection::vec(
                prop::collection::vec(prop::array::uniform3(-3i8..3), 0..9),
                0..4,
            )
        ) {
            let corner = |p: [i8; 3]| DVec3::from_array(p.map(f64::from));
            let polygon: Vec<Vec<DVec3>> =
                polygon.into_iter().map(|contour| contour.into_iter().map(corner).collect()).collect();
            let corners = polygon.concat().len();
            for number in Triangulator::default().triangulate(&polygon).concat() {
                prop_assert!((number as usize) < corners);
            }
        }
    }
}
