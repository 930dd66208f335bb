//! How the delay of a link varies.

use std::time::Duration;

use serde::Deserialize;

use super::Probability;
use crate::random::Random;

/// How the delay varies from packet to packet.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Jitter {
    /// The standard deviation of the delay; for `uniform`, half of the range.
    #[serde(deserialize_with = "crate::text::duration")]
    pub deviation: Duration,
    /// The shape.
    #[serde(default)]
    pub distribution: Distribution,
    /// The correlation of consecutive delays, more precisely of the normal variable behind them.
    #[serde(default)]
    pub correlation: Probability,
    /// Whether a packet may overtake another. Most link layers deliver in order: a packet then waits for the
    /// one before.
    #[serde(default)]
    pub reorders: bool,
}

/// The shape of a variation of mean 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// Evenly between minus and plus the deviation.
    Uniform,
    /// Gauss's.
    #[default]
    Normal,
    /// Pareto with a shape of 3: mostly a little early, sometimes much too late.
    Pareto,
}

impl Distribution {
    /// The value whose probability is that of the standard normal value `latent`.
    fn quantile(self, latent: f64) -> f64 {
        // The upper tail probability: exact where Pareto's large values come from.
        let above = || 0.5 * libm::erfc(latent * core::f64::consts::FRAC_1_SQRT_2);
        match self {
            Self::Normal => latent,
            Self::Uniform => 1.0 - 2.0 * above(),
            // With shape 3 and scale 1 the mean is 3/2 and the variance 3/4.
            Self::Pareto => (libm::cbrt(1.0 / above().max(f64::MIN_POSITIVE)) - 1.5) / libm::sqrt(0.75),
        }
    }
}

/// The delays of consecutive packets.
#[derive(Debug)]
pub(super) struct Variation {
    random: Random,
    latent: f64,
}

impl Variation {
    pub(super) fn new(mut random: Random) -> Self {
        let latent = random.normal();
        Self { random, latent }
    }

    /// The delay of the next packet: `mean` and its variation, never below zero.
    pub(super) fn delay(&mut self, mean: Duration, jitter: Option<&Jitter>) -> Duration {
        let Some(jitter) = jitter else { return mean };
        let rho = jitter.correlation.get();
        // Autoregressive of order one: each value is normal, and neighbours have the correlation rho.
        self.latent = rho * self.latent + libm::sqrt(1.0 - rho * rho) * self.random.normal();
        let varied = jitter.distribution.quantile(self.latent) * jitter.deviation.as_nanos() as f64;
        let nanos = mean.as_nanos() as f64 + varied;
        Duration::from_nanos(libm::round(nanos.max(0.0)) as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MEAN: Duration = Duration::from_millis(100);

    fn jitter(distribution: Distribution, correlation: f64) -> Jitter {
        let deviation = Duration::from_millis(5);
        Jitter {
            deviation,
            distribution,
            correlation: Probability::new(correlation).unwrap(),
            reorders: false,
        }
    }

    /// Samples of the variation, in deviations.
    fn sample(jitter: &Jitter) -> Vec<f64> {
        let mut variation = Variation::new(Random::stream(0, 11));
        let mut one = || variation.delay(MEAN, Some(jitter)).as_nanos() as f64;
        (0..400_000).map(|_| (one() - 100e6) / 5e6).collect()
    }

    fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
        let count = values.len() as f64;
        values.sum::<f64>() / count
    }

    #[test]
    fn each_distribution_has_its_mean_and_deviation() {
        for (distribution, variance, slack) in [
            (Distribution::Normal, 1.0, 0.01),
            (Distribution::Uniform, 1.0 / 3.0, 0.01),
            // The fourth moment is infinite, so the variance of a sample is far off.
            (Distribution::Pareto, 1.0, 0.3),
        ] {
            let values = sample(&jitter(distribution, 0.0));
            let m = mean(values.iter().copied());
            let v = mean(values.iter().map(|x| (x - m) * (x - m)));
            assert!(m.abs() < 0.01 && (v - variance).abs() < slack, "{distribution:?}: {m} {v}");
        }
    }

    #[test]
    fn shapes_are_what_their_names_say() {
        let share = |distribution, wanted: fn(f64) -> bool| {
            let values = sample(&jitter(distribution, 0.0));
            values.iter().filter(|x| wanted(**x)).count() as f64 / values.len() as f64
        };
        assert!((share(Distribution::Normal, |x| x.abs() < 1.0) - 0.6827).abs() < 0.005);
        assert!((share(Distribution::Uniform, |x| x < -0.5) - 0.25).abs() < 0.005);
        assert_eq!(share(Distribution::Uniform, |x| x.abs() > 1.0001), 0.0);
        // Pareto: P(X > x) = x^-3 with X = 1.5 + 0.866 x.
        assert!(
            (share(Distribution::Pareto, |x| x > 3.0) - (1.5 + 3.0 * 0.75_f64.sqrt()).powi(-3)).abs() < 0.001
        );
        assert_eq!(share(Distribution::Pareto, |x| x < -0.5774), 0.0);
    }

    #[test]
    fn neighbours_are_correlated_as_told() {
        for rho in [0.0, 0.3, 0.9] {
            let values = sample(&jitter(Distribution::Normal, rho));
            let pairs = values.windows(2).map(|pair| pair[0] * pair[1]);
            let got = mean(pairs.collect::<Vec<_>>().into_iter());
            assert!((got - rho).abs() < 0.02, "{got} for {rho}");
        }
    }

    #[test]
    fn a_delay_is_never_negative() {
        let wild = Jitter { deviation: Duration::from_secs(1), ..jitter(Distribution::Normal, 0.0) };
        let mut variation = Variation::new(Random::stream(0, 1));
        let zeros = (0..1000).filter(|_| variation.delay(MEAN, Some(&wild)).is_zero()).count();
        assert!((400..600).contains(&zeros), "{zeros}");
    }
}
