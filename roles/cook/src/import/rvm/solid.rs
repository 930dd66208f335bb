//! Builds closed surfaces from rings of vertices, in the frame of a primitive.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use glam::DVec3;

/// A surface under construction: vertices are shared, triangles wind counter-clockwise as seen from outside.
#[derive(Debug, Default)]
pub(super) struct Solid {
    pub positions: Vec<DVec3>,
    pub indices: Vec<u32>,
    /// Polygons with too many corners to be cut exactly.
    pub large_polygons: u64,
}

/// Consecutive vertices that close to a ring, counter-clockwise as seen from the solid's continuation.
#[derive(Debug, Clone)]
pub(super) struct Ring(Range<u32>);

impl Solid {
    pub(super) fn vertex(&mut self, position: DVec3) -> u32 {
        self.positions.push(position);
        self.positions.len() as u32 - 1
    }

    pub(super) fn ring(&mut self, positions: impl IntoIterator<Item = DVec3>) -> Ring {
        let first = self.positions.len() as u32;
        self.positions.extend(positions);
        Ring(first..self.positions.len() as u32)
    }

    pub(super) fn triangle(&mut self, corners: [u32; 3]) {
        self.indices.extend(corners);
    }

    /// The wall between two rings, which may have different numbers of vertices; `lower` comes first along
    /// the solid.
    pub(super) fn wall(&mut self, lower: &Ring, upper: &Ring) {
        let (n, m) = (lower.count(), upper.count());
        let (mut i, mut j) = (0, 0);
        while i < n || j < m {
            // Advance along the ring whose next vertex comes first around the axis.
            if j == m || (i < n && (i + 1) * m <= (j + 1) * n) {
                self.triangle([lower.at(i), lower.at(i + 1), upper.at(j)]);
                i += 1;
            } else {
                self.triangle([lower.at(i), upper.at(j + 1), upper.at(j)]);
                j += 1;
            }
        }
    }

    /// The wall from a ring to a single vertex at the solid's end.
    pub(super) fn cone_to(&mut self, ring: &Ring, tip: u32) {
        for (a, b) in ring.edges() {
            self.triangle([a, b, tip]);
        }
    }

    /// The wall from a single vertex at the solid's beginning to a ring.
    pub(super) fn cone_from(&mut self, tip: u32, ring: &Ring) {
        for (a, b) in ring.edges() {
            self.triangle([b, a, tip]);
        }
    }

    /// Closes the solid at its end.
    pub(super) fn end(&mut self, ring: &Ring) {
        self.cap(ring, |[a, b, c]| [a, b, c]);
    }

    /// Closes the solid at its beginning.
    pub(super) fn begin(&mut self, ring: &Ring) {
        self.cap(ring, |[a, b, c]| [a, c, b]);
    }

    /// A convex ring filled from side to side, which makes better triangles than a fan.
    fn cap(&mut self, ring: &Ring, turn: impl Fn([u32; 3]) -> [u32; 3]) {
        let (mut low, mut high) = (ring.0.start, ring.0.end.saturating_sub(1));
        while high >= low + 2 {
            self.triangle(turn([low, low + 1, high]));
            low += 1;
            if high >= low + 2 {
                self.triangle(turn([low, high - 1, high]));
                high -= 1;
            }
        }
    }

    /// Merges vertices at the same position, and drops the triangles that thereby lose their area.
    pub(super) fn collapse(&mut self) {
        let mut order: Vec<u32> = (0..self.positions.len() as u32).collect();
        let key = |&index: &u32| {
            self.positions.get(index as usize).map(|p| (p + DVec3::ZERO).to_array().map(f64::to_bits))
        };
        order.sort_by_key(key);
        let mut first = vec![0; order.len()];
        for same in order.chunk_by(|a, b| key(a) == key(b)) {
            // The sort is stable, so the first of equals has the least index.
            for &index in same {
                if let (Some(slot), Some(&least)) = (first.get_mut(index as usize), same.first()) {
                    *slot = least;
                }
            }
        }
        let merged = |&index: &u32| first.get(index as usize).copied().unwrap_or(index);
        let triangles =
            self.indices.as_chunks::<3>().0.iter().map(|triangle| triangle.each_ref().map(merged));
        self.indices = triangles.filter(|[a, b, c]| a != b && b != c && c != a).flatten().collect();
    }
}

impl Ring {
    fn count(&self) -> u64 {
        u64::from(self.0.end - self.0.start)
    }

    /// Vertex `index` around, wrapping after the last.
    fn at(&self, index: u64) -> u32 {
        if index < self.count() { self.0.start + index as u32 } else { self.0.start }
    }

    /// Each vertex with the next one around.
    fn edges(&self) -> impl Iterator<Item = (u32, u32)> + use<> {
        let Range { start, end } = self.0;
        (start..end).zip((start + 1..end).chain(std::iter::once(start)))
    }
}

/// The fineness of curves: the tolerance in the primitive's own units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chord {
    pub tolerance: f64,
}

/// The most chords of a curve.
pub(super) const MOST_CHORDS: usize = 1024;

/// The finest tolerance relative to a curve's size: its radius, or its length if that is less. So a circle
/// has at most 223 chords. At 1 mm this applies from a radius of 10 m on; otherwise one number in a file
/// could make millions of triangles.
const FINEST: f64 = 1e-4;

impl Chord {
    /// The fewest equal chords along `angle` of a circle within the tolerance: a chord over the angle a is r
    /// (1 - cos a/2) off. No chord spans more than a sixth of a turn, so that the thinnest pipe is still a
    /// pipe.
    pub(super) fn count(self, radius: f64, angle: f64) -> usize {
        let angle = angle.abs().min(TAU);
        let relative = (self.tolerance / radius.abs()).max(FINEST * angle.min(1.0));
        let half = libm::acos((1.0 - relative).clamp(-1.0, 1.0));
        let step = (2.0 * half).min(PI / 3.0);
        // A zero step divides to infinity, which the clamp handles; NaN casts to 0.
        ((angle / step).ceil().clamp(1.0, MOST_CHORDS as f64) as usize).max(1)
    }
}

/// The points at `count` equal steps around the unit circle.
pub(super) fn circle(count: usize) -> impl Iterator<Item = (f64, f64)> + Clone {
    (0..count).map(move |index| direction(TAU * index as f64 / count as f64))
}

/// The cosine and sine of an angle, equal on every machine.
pub(super) fn direction(angle: f64) -> (f64, f64) {
    (libm::cos(angle), libm::sin(angle))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chords_stay_within_the_tolerance_and_are_no_finer_than_needed() {
        let sagitta = |radius: f64, chords: usize| radius * (1.0 - (PI / chords as f64).cos());
        for radius in [20.0, 57.0, 300.0, 5000.0] {
            let chords = Chord { tolerance: 1.0 }.count(radius, TAU);
            assert!(sagitta(radius, chords) <= 1.0, "{radius}: {chords}");
            assert!(sagitta(radius, chords - 1) > 1.0, "{radius}: {chords}");
        }
    }

    #[test]
    fn degenerate_curves_have_few_chords() {
        let chord = Chord { tolerance: 1.0 };
        assert_eq!(chord.count(0.0, TAU), 6);
        assert_eq!(chord.count(0.5, TAU), 6);
        assert_eq!(chord.count(10.0, 0.0), 1);
        assert_eq!(chord.count(1e30, TAU), 223);
        assert_eq!(chord.count(f64::INFINITY, TAU), 223);
        assert_eq!(chord.count(1e30, 1e-6), 1);
        assert_eq!(chord.count(0.5, 1e30), 6);
    }

    #[test]
    fn collapsing_makes_a_tip_of_a_ring() {
        let mut solid = Solid::default();
        let lower = solid.ring(circle(4).map(|(x, y)| DVec3::new(x, y, 0.0)));
        let upper = solid.ring([0.0, -0.0, 0.0, -0.0].map(|x| DVec3::new(x, 0.0, 1.0)));
        solid.wall(&lower, &upper);
        solid.begin(&lower);
        solid.collapse();
        assert_eq!(solid.indices.len() / 3, 4 + 2);
    }
}
