//! A mean or a median over walks, and how sure it is.

use trimaran_scene::random::Random;

/// A figure of several walks with its 95 % interval, by the percentile bootstrap (Efron 1979): the walks'
/// figures are drawn again with replacement, and the interval holds 95 % of what they give.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    pub(crate) value: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// How often they are drawn again.
const RESAMPLES: usize = 4000;

impl Interval {
    /// The mean of one figure a walk. `None` without any; those that are not finite are left out. The same
    /// figures always have the same interval.
    pub(crate) fn of_mean(figures: impl IntoIterator<Item = f64>) -> Option<Self> {
        Self::of(figures, |figures| Some(figures.iter().sum::<f64>() / figures.len() as f64))
    }

    /// The same of the median, by nearest rank.
    pub(crate) fn of_median(figures: impl IntoIterator<Item = f64>) -> Option<Self> {
        Self::of(figures, |figures| {
            let middle = figures.len().checked_sub(1)? / 2;
            Some(*figures.select_nth_unstable_by(middle, f64::total_cmp).1)
        })
    }

    /// Of a statistic, which may reorder the figures.
    fn of(
        figures: impl IntoIterator<Item = f64>,
        statistic: impl Fn(&mut [f64]) -> Option<f64>,
    ) -> Option<Self> {
        let mut figures: Vec<f64> = figures.into_iter().filter(|figure| figure.is_finite()).collect();
        let count = figures.len();
        if count == 0 {
            return None;
        }
        let mut again = Vec::with_capacity(count);
        let mut drawn_again = |index: u64| {
            let mut random = Random::stream(1, 0, index);
            again.clear();
            again.extend((0..count).filter_map(|_| figures.get(random.below(count))));
            statistic(&mut again)
        };
        let mut values: Vec<f64> = (0..RESAMPLES as u64).filter_map(&mut drawn_again).collect();
        values.sort_by(f64::total_cmp);
        let at = |part: usize| values.get(RESAMPLES * part / 1000).copied();
        Some(Self { low: at(25)?, high: at(975)?, value: statistic(&mut figures)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_figures_and_a_single_one_are_sure() {
        let sure = |value| Some(Interval { value, low: value, high: value });
        let both: [fn(Vec<f64>) -> Option<Interval>; 2] = [Interval::of_mean, Interval::of_median];
        for of in both {
            assert_eq!(of(vec![7.5]), sure(7.5));
            assert_eq!(of(vec![2.0; 9]), sure(2.0));
            assert_eq!(of(vec![]), None);
            assert_eq!(of(vec![f64::NAN, 3.0]), sure(3.0));
        }
    }

    #[test]
    fn one_slow_walk_of_nine_moves_the_mean_and_not_the_median() {
        let figures = [30.0, 31.0, 32.0, 33.0, 34.0, 35.0, 36.0, 37.0, 1.0];
        let median = Interval::of_median(figures).unwrap();
        assert_eq!(median.value, 33.0);
        assert!(median.low >= 30.0 && median.high <= 37.0, "{median:?}");
        assert!(Interval::of_mean(figures).unwrap().low < 25.0);
        // By nearest rank the median of an even number is the lower of the two in the middle.
        assert_eq!(Interval::of_median([4.0, 1.0, 3.0, 2.0]).unwrap().value, 2.0);
    }

    /// Of a normal distribution the interval of the mean is 1.96 standard errors to each side. With 400
    /// figures the bootstrap comes close to that.
    #[test]
    fn many_figures_have_the_interval_of_a_normal_distribution() {
        let mut random = Random::new(5);
        // The sum of twelve of the uniform distribution: deviation 1.
        let figures: Vec<f64> = (0..400).map(|_| (0..12).map(|_| random.unit()).sum()).collect();
        let interval = Interval::of_mean(figures).unwrap();
        assert!((interval.value - 6.0).abs() < 0.15, "{interval:?}");
        for side in [interval.value - interval.low, interval.high - interval.value] {
            assert!((side - 1.96 / 20.0).abs() < 0.015, "{interval:?}");
        }
    }
}
