//! How close surfaces may be in formats of depth: a computation, without a device.

/// A format of depth, and how distances are mapped to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DepthFormat {
    /// Near over distance in f32: what Trimaran uses, without a far plane.
    Reversed32,
    /// From 0 at the near plane to 1 at the far one, in f32.
    Forward32,
    /// The same in 24 bits.
    Forward24,
    /// The same in 16 bits.
    Forward16,
}

/// The far plane of formats that need one, metres.
pub(super) const FAR: f64 = 1e6;

impl DepthFormat {
    pub(super) const ALL: [Self; 4] = [Self::Reversed32, Self::Forward32, Self::Forward24, Self::Forward16];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Reversed32 => "D32, reversed: Trimaran's",
            Self::Forward32 => "D32, forward",
            Self::Forward24 => "D24, forward",
            Self::Forward16 => "D16, forward",
        }
    }

    /// The value stored for a distance: greater is farther.
    fn stored(self, near: f64, distance: f64) -> f64 {
        let forward = FAR / (FAR - near) * (1.0 - near / distance);
        let in_bits = |bits: i32| (forward * (2_f64.powi(bits) - 1.0)).round();
        match self {
            Self::Reversed32 => -f64::from((near / distance) as f32),
            Self::Forward32 => f64::from(forward as f32),
            Self::Forward24 => in_bits(24),
            Self::Forward16 => in_bits(16),
        }
    }

    /// The smallest gap, of the distance, that keeps the order of any two surfaces about this distance; none
    /// up to a half.
    pub(super) fn resolved(self, near: f64, distance: f64) -> Option<f64> {
        // Roundings differ from place to place.
        let places = || (0..64).map(|place| distance * (1.0 + f64::from(place) / 97.0));
        let keeps =
            |gap: &f64| places().all(|at| self.stored(near, at) < self.stored(near, at * (1.0 + gap)));
        (1..=30).rev().map(|power| 0.5_f64.powi(power)).find(keeps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_reversed_depth_resolves_far_away_as_well_as_near() {
        let at = |format: DepthFormat, distance| format.resolved(1e-3, distance);
        for distance in [0.01, 1.0, 1e3, 1e5] {
            assert!(at(DepthFormat::Reversed32, distance).unwrap() <= 1.2e-7, "{distance}");
        }
        for format in [DepthFormat::Forward32, DepthFormat::Forward24] {
            assert!(at(format, 0.01).unwrap() < 2e-6, "{format:?}");
            assert!(at(format, 1e3).unwrap() > 0.05, "{format:?}");
            assert_eq!(at(format, 1e5), None, "{format:?}");
        }
        assert_eq!(at(DepthFormat::Forward16, 1e3), None);
    }
}
