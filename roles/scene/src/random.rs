//! Random numbers that are the same on every platform and in every release, for camera paths and generated
//! models.

use glam::{DQuat, DVec3};

/// SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014). It is a dozen
/// lines of integer arithmetic instead of a crate, because a seed must give the same model for ever.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// The stream of a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// An independent stream for one `purpose` and one `index` of it.
    #[must_use]
    pub fn stream(seed: u64, purpose: u64, index: u64) -> Self {
        let mut random = Self(seed ^ purpose.wrapping_mul(0xd6e8_feb8_6659_fd93));
        let start = random.bits() ^ index.wrapping_mul(0xa076_1d64_78bd_642f);
        Self(start)
    }

    /// 64 random bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `0 .. 1`, with 53 random bits.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in `low .. high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in `0 .. count`; 0 if `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        ((u128::from(self.bits()) * count as u128) >> 64) as usize
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// A point in the box from `min` to `max`, evenly.
    pub fn point(&mut self, min: DVec3, max: DVec3) -> DVec3 {
        DVec3::new(self.between(min.x, max.x), self.between(min.y, max.y), self.between(min.z, max.z))
    }

    /// A unit vector, evenly.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let point = self.point(DVec3::splat(-1.0), DVec3::ONE);
            if (1e-4..=1.0).contains(&point.length_squared()) {
                return point.normalize();
            }
        }
    }

    /// A rotation about an even direction by an even angle.
    pub fn rotation(&mut self) -> DQuat {
        let axis = self.direction();
        DQuat::from_axis_angle(axis, self.between(0.0, std::f64::consts::TAU))
    }

    /// One of the values.
    pub fn pick<T: Copy, const N: usize>(&mut self, values: [T; N]) -> T {
        const { assert!(N > 0) };
        values[self.below(N)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_is_the_published_one() {
        // First outputs for seed 1234567, as in Vigna's reference code.
        let mut random = Random::new(1_234_567);
        assert_eq!(random.bits(), 6_457_827_717_110_365_317);
        assert_eq!(random.bits(), 3_203_168_211_198_807_973);
    }

    #[test]
    fn values_stay_in_range_and_spread() {
        let mut random = Random::new(1);
        let mut counts = [0; 7];
        for _ in 0..7000 {
            counts[random.below(7)] += 1;
            assert!((2.0..3.0).contains(&random.between(2.0, 3.0)));
        }
        assert!(counts.iter().all(|c| (800..1200).contains(c)), "{counts:?}");
        assert_eq!(random.below(0), 0);
        let (low, high) = (DVec3::new(-3.0, 0.0, 7.0), DVec3::new(-2.0, 5.0, 7.5));
        for _ in 0..100 {
            let point = random.point(low, high);
            assert!(point.cmpge(low).all() && point.cmplt(high).all(), "{point}");
            assert!(random.direction().is_normalized() && random.rotation().is_normalized());
        }
    }

    #[test]
    fn streams_differ() {
        let first = |purpose, index| Random::stream(7, purpose, index).bits();
        assert_ne!(first(0, 0), first(0, 1));
        assert_ne!(first(0, 1), first(1, 0));
    }
}
