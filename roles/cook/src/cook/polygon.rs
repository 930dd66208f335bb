//! Small convex polygons: the parts of a triangle in the certificate.

use glam::Vec3;

use super::linear::bounds;

/// The most corners of a polygon: cuts add corners, and beyond this only [`Polygon::halves`] divides it.
const MOST: usize = 8;

/// A convex polygon, flat up to rounding.
#[derive(Debug, Clone, Copy)]
pub(super) struct Polygon {
    corners: [Vec3; MOST],
    count: usize,
}

/// A polygon cut in two along a line.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "lives on the stack for the length of one cut")]
pub(super) enum Cut {
    /// All of it is on the side of positive values, or on the line.
    Positive,
    /// All of it is on the side of negative values.
    Negative,
    /// The positive part, then the negative one. They share the corners on the line.
    Both(Polygon, Polygon),
}

impl Polygon {
    const EMPTY: Self = Self { corners: [Vec3::ZERO; MOST], count: 0 };

    pub(super) fn triangle(corners: [Vec3; 3]) -> Self {
        Self::EMPTY.with(corners[0]).with(corners[1]).with(corners[2])
    }

    pub(super) fn corners(&self) -> &[Vec3] {
        self.corners.get(..self.count).unwrap_or_default()
    }

    pub(super) fn centre(&self) -> Vec3 {
        self.corners().iter().sum::<Vec3>() / self.count as f32
    }

    /// The length of the longest side of the box around the polygon.
    pub(super) fn extent(&self) -> f32 {
        let (min, max) = bounds(self.corners().iter().copied());
        (max - min).max_element()
    }

    pub(super) fn area(&self) -> f32 {
        let Some((&first, rest)) = self.corners().split_first() else { return 0.0 };
        let fan = rest.iter().zip(rest.iter().skip(1)).map(|(&p, &q)| (p - first).cross(q - first));
        0.5 * fan.sum::<Vec3>().length()
    }

    /// The polygon with one more corner; callers prevent a ninth, which would be ignored.
    fn with(mut self, corner: Vec3) -> Self {
        if let Some(slot) = self.corners.get_mut(self.count) {
            *slot = corner;
            self.count += 1;
        }
        self
    }

    /// Cuts at the zero of `value`, treated as linear along each edge. `None` if there are no two convex
    /// parts: the sign changes more than twice around the polygon, the value is NaN, or there are too many
    /// corners.
    pub(super) fn cut(&self, value: impl Fn(Vec3) -> f32) -> Option<Cut> {
        let mut values = [0.0; MOST];
        for (slot, &corner) in values.iter_mut().zip(self.corners()) {
            *slot = value(corner);
        }
        let values = values.get(..self.count)?;
        if values.iter().any(|v| v.is_nan()) {
            return None;
        }
        if values.iter().all(|&v| v >= 0.0) {
            return Some(Cut::Positive);
        }
        if values.iter().all(|&v| v < 0.0) {
            return Some(Cut::Negative);
        }
        if self.count == MOST {
            return None;
        }
        let (mut positive, mut negative) = (Self::EMPTY, Self::EMPTY);
        let mut changes = 0;
        let ends = || self.corners().iter().zip(values);
        for ((&p, &from), (&q, &to)) in ends().zip(ends().cycle().skip(1)) {
            if from >= 0.0 {
                positive = positive.with(p);
            } else {
                negative = negative.with(p);
            }
            if (from >= 0.0) != (to >= 0.0) {
                let point = p.lerp(q, from / (from - to));
                (positive, negative) = (positive.with(point), negative.with(point));
                changes += 1;
            }
        }
        (changes == 2).then_some(Cut::Both(positive, negative))
    }

    /// Two parts of about half its length: by a line across its longest edge's direction, or between two of
    /// its corners if it has many.
    pub(super) fn halves(&self) -> [Self; 2] {
        if self.count == MOST {
            let (low, high) = self.corners.split_at(MOST / 2);
            let around = |part: &[Vec3], next: Vec3| {
                part.iter().fold(Self::EMPTY, |polygon, &p| polygon.with(p)).with(next)
            };
            return [around(low, high[0]), around(high, low[0])];
        }
        let ends = || self.corners().iter();
        let along =
            ends().zip(ends().cycle().skip(1)).map(|(&p, &q)| q - p).fold(Vec3::ZERO, |longest, edge| {
                if edge.length_squared() > longest.length_squared() { edge } else { longest }
            });
        let (low, high) = ends()
            .map(|p| along.dot(*p))
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), d| (l.min(d), h.max(d)));
        let middle = low.midpoint(high);
        match self.cut(|p| along.dot(p) - middle) {
            Some(Cut::Both(first, second)) => [first, second],
            // Too small to be cut in single precision.
            _ => [*self, *self],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn right() -> Polygon {
        Polygon::triangle([Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 2.0])
    }

    #[test]
    fn a_line_cuts_a_triangle_into_a_triangle_and_a_quadrangle() {
        let Some(Cut::Both(positive, negative)) = right().cut(|p| p.x - 2.0) else { panic!("not cut") };
        assert_eq!(positive.corners(), [Vec3::new(2.0, 0.0, 0.0), Vec3::X * 4.0, Vec3::new(2.0, 1.0, 0.0)]);
        assert_eq!(
            negative.corners(),
            [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(2.0, 1.0, 0.0), Vec3::Y * 2.0]
        );
    }

    #[test]
    fn a_line_outside_leaves_it_whole_one_along_an_edge_does_not_and_nonsense_is_refused() {
        assert!(matches!(right().cut(|p| p.x), Some(Cut::Positive)));
        assert!(matches!(right().cut(|p| p.x - 5.0), Some(Cut::Negative)));
        assert!(matches!(right().cut(|p| -p.x), Some(Cut::Both(..))), "an edge on the line is positive");
        assert!(right().cut(|_| f32::NAN).is_none());
        // Positive at two corners that are not adjacent.
        let square =
            Polygon::EMPTY.with(Vec3::ZERO).with(Vec3::X).with(Vec3::new(1.0, 1.0, 0.0)).with(Vec3::Y);
        assert!(square.cut(|p| (p.x - 0.5) * (p.y - 0.5)).is_none());
    }

    #[test]
    fn halves_shrink_and_cover() {
        let mut parts = vec![right()];
        for _ in 0..8 {
            parts = parts.iter().flat_map(Polygon::halves).collect();
        }
        assert!((parts.iter().map(Polygon::area).sum::<f32>() - 4.0).abs() < 1e-4);
        assert!(parts.iter().all(|part| part.extent() < 0.6));
    }

    #[test]
    fn eight_corners_are_parted_between_two_of_them() {
        let corner = |i: usize| Vec3::new((i as f32).cos(), (i as f32).sin(), 0.0);
        let round = (0..9).fold(Polygon::EMPTY, |polygon, i| polygon.with(corner(i)));
        assert_eq!(round.corners().len(), MOST, "the ninth is left out");
        let [low, high] = round.halves();
        assert_eq!((low.corners()[4], high.corners()[4]), (corner(4), corner(0)));
    }
}
