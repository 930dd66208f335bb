//! The simulator's random numbers: the same for a seed on every platform and in every release.

/// SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014). A dozen lines
/// of integer arithmetic rather than a crate, because a seed must give the same run for ever, and a crate may
/// change.
#[derive(Debug, Clone)]
pub(crate) struct Random(u64);

impl Random {
    /// An independent stream: the `index`-th of this seed.
    pub(crate) const fn stream(seed: u64, index: u64) -> Self {
        let mut first = Self(seed);
        let start = first.bits() ^ index.wrapping_mul(0xa076_1d64_78bd_642f);
        let mut second = Self(start);
        Self(second.bits())
    }

    pub(crate) const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `0 .. 1`, with 53 random bits.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// True with the given probability. Draws nothing where the answer is certain, so a setting that is off
    /// changes no others.
    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        probability > 0.0 && (probability >= 1.0 || self.unit() < probability)
    }

    /// Normally distributed, mean 0 and deviation 1 (Box and Muller, 1958).
    pub(crate) fn normal(&mut self) -> f64 {
        // 1 - unit lies in (0, 1], where the logarithm is finite.
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(core::f64::consts::TAU * self.unit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_is_the_published_one() {
        // First outputs for seed 1234567, as in Vigna's reference code.
        let mut random = Random(1_234_567);
        assert_eq!(random.bits(), 6_457_827_717_110_365_317);
        assert_eq!(random.bits(), 3_203_168_211_198_807_973);
    }

    #[test]
    fn streams_differ() {
        let first = |seed, index| Random::stream(seed, index).bits();
        assert_ne!(first(7, 0), first(7, 1));
        assert_ne!(first(7, 0), first(8, 0));
    }

    #[test]
    fn the_normal_distribution_has_its_moments() {
        let mut random = Random(3);
        let values: Vec<f64> = (0..200_000).map(|_| random.normal()).collect();
        let moment = |power| values.iter().map(|x: &f64| x.powi(power)).sum::<f64>() / values.len() as f64;
        let [mean, variance, skew, kurtosis] = [moment(1), moment(2), moment(3), moment(4)];
        assert!(mean.abs() < 0.01 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
        assert!(skew.abs() < 0.05 && (kurtosis - 3.0).abs() < 0.1, "{skew} {kurtosis}");
    }
}
