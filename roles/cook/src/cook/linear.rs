//! Stretch factors of linear maps, and boxes in the world.

use glam::{DMat3, DVec3, Vec3};

/// An axis-aligned box in the world, metres. Empty boxes have infinite corners the wrong way round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WorldBox {
    pub(super) min: DVec3,
    pub(super) max: DVec3,
}

impl WorldBox {
    pub(super) const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The smallest box around all points.
    pub(super) fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, Self::including)
    }

    /// A box around a placed one.
    pub(super) fn placed(min: Vec3, max: Vec3, linear: DMat3, origin: DVec3) -> Self {
        let corners = (0..8_u32).map(|corner| {
            let pick =
                |axis: u32, low: f32, high: f32| f64::from(if corner >> axis & 1 == 0 { low } else { high });
            linear * DVec3::new(pick(0, min.x, max.x), pick(1, min.y, max.y), pick(2, min.z, max.z)) + origin
        });
        Self::around(corners).padded()
    }

    pub(super) fn including(self, point: DVec3) -> Self {
        Self { min: self.min.min(point), max: self.max.max(point) }
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub(super) fn centre(self) -> DVec3 {
        self.min + 0.5 * (self.max - self.min)
    }

    pub(super) fn diagonal(self) -> f64 {
        (self.max - self.min).length()
    }

    /// Grown by a few units in the last place, to contain points computed with other roundings.
    pub(super) fn padded(self) -> Self {
        let margin = 4.0 * f64::EPSILON * self.min.abs().max(self.max.abs());
        Self { min: self.min - margin, max: self.max + margin }
    }
}

/// The lower and the upper corner of the box around some points; infinite and inverted if there are none.
pub(super) fn bounds(points: impl IntoIterator<Item = Vec3>) -> (Vec3, Vec3) {
    let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    points.into_iter().fold(empty, |(min, max), p| (min.min(p), max.max(p)))
}

/// An upper bound, tight to rounding, of the largest singular value of `a`: the largest stretch of a
/// distance.
///
/// The square root of the largest eigenvalue of `aᵀa`, by the trigonometric formula for symmetric 3x3
/// matrices (O. K. Smith, "Eigenvalues of a symmetric 3 x 3 matrix", 1961).
pub(super) fn largest_stretch(a: DMat3) -> f64 {
    let scale = a.to_cols_array().into_iter().fold(0.0, |m: f64, c| m.max(c.abs()));
    if scale == 0.0 {
        return 0.0;
    }
    let a = a * (1.0 / scale);
    let s = a.transpose() * a;
    let mean = (s.x_axis.x + s.y_axis.y + s.z_axis.z) / 3.0;
    let b = s - DMat3::from_diagonal(DVec3::splat(mean));
    let squares: f64 = b.to_cols_array().into_iter().map(|c| c * c).sum();
    let p = (squares / 6.0).sqrt();
    let cosine = if p > 0.0 { ((b * (1.0 / p)).determinant() / 2.0).clamp(-1.0, 1.0) } else { 1.0 };
    let largest = mean + 2.0 * p * (cosine.acos() / 3.0).cos();
    scale * largest.sqrt() * (1.0 + 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn stretch_of_named_maps() {
        let close = |a: DMat3, expected: f64| {
            let got = largest_stretch(a);
            assert!(got >= expected && got <= expected * (1.0 + 1e-7), "{got} for {expected}");
        };
        close(DMat3::IDENTITY, 1.0);
        close(DMat3::from_diagonal(DVec3::new(1e-3, 5.0, -2.0)), 5.0);
        close(DMat3::from_diagonal(DVec3::new(1e-200, -1e-200, 0.0)), 1e-200);
        close(DMat3::from_rotation_y(0.3) * 1e6, 1e6);
        // The unit shear stretches by the golden ratio.
        close(
            DMat3::from_cols(DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Z),
            f64::midpoint(1.0, 5.0_f64.sqrt()),
        );
        assert_eq!(largest_stretch(DMat3::ZERO), 0.0);
    }

    proptest! {
        #[test]
        fn no_direction_is_stretched_more(m in prop::array::uniform9(-10.0..10.0_f64), v in prop::array::uniform3(-1.0..1.0_f64)) {
            let a = DMat3::from_cols_array(&m);
            let v = DVec3::from_array(v);
            prop_assert!((a * v).length() <= largest_stretch(a) * v.length() * (1.0 + 1e-12));
        }
    }
}
