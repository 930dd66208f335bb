//! A mean over paths, and how sure it is.

use trimaran_scene::random::Random;

/// A mean with its 95 % interval, by the percentile bootstrap (Efron 1979): the figures of the paths are
/// drawn again with replacement, and the interval holds 95 % of the means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Interval {
    pub(super) mean: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

/// How often they are drawn again.
const RESAMPLES: usize = 4000;

impl Interval {
    /// Of one figure a path. `None` without any; those that are not finite are left out. The same figures
    /// always have the same interval.
    pub(super) fn of(figures: impl IntoIterator<Item = f64>) -> Option<Self> {
        let figures: Vec<f64> = figures.into_iter().filter(|figure| figure.is_finite()).collect();
        let count = figures.len();
        if count == 0 {
            return None;
        }
        let mean = |sum: f64| sum / count as f64;
        let drawn_again = |index: u64| {
            let mut random = Random::stream(1, 0, index);
            let figures = (0..count).filter_map(|_| figures.get(random.below(count)));
            mean(figures.sum())
        };
        let mut means: Vec<f64> = (0..RESAMPLES as u64).map(drawn_again).collect();
        means.sort_by(f64::total_cmp);
        let at = |part: usize| means.get(RESAMPLES * part / 1000).copied();
        Some(Self { mean: mean(figures.iter().sum()), low: at(25)?, high: at(975)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_figures_and_a_single_one_are_sure() {
        assert_eq!(Interval::of([7.5]), Some(Interval { mean: 7.5, low: 7.5, high: 7.5 }));
        assert_eq!(Interval::of([2.0; 9]), Some(Interval { mean: 2.0, low: 2.0, high: 2.0 }));
        assert_eq!(Interval::of([]), None);
        assert_eq!(Interval::of([f64::NAN, 3.0]), Interval::of([3.0]));
    }

    /// Of a normal distribution the interval of the mean is 1.96 standard errors to each side. With 400
    /// figures the bootstrap comes close to that.
    #[test]
    fn many_figures_have_the_interval_of_a_normal_distribution() {
        let mut random = Random::new(5);
        // The sum of twelve of the uniform distribution: deviation 1.
        let figures: Vec<f64> = (0..400).map(|_| (0..12).map(|_| random.unit()).sum()).collect();
        let interval = Interval::of(figures).unwrap();
        assert!((interval.mean - 6.0).abs() < 0.15, "{interval:?}");
        for side in [interval.mean - interval.low, interval.high - interval.mean] {
            assert!((side - 1.96 / 20.0).abs() < 0.015, "{interval:?}");
        }
    }
}
