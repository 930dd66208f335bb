//! Maps values to positions in a drawing.

/// A vertical axis is logarithmic where the largest value is more than this many times the median.
const LOG_ABOVE: f64 = 6.0;
/// A horizontal axis is logarithmic where the largest value is more than this many times the smallest.
const LOG_X_ABOVE: f64 = 50.0;

/// A map from values to SVG units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    /// The value at `from`.
    pub(super) low: f64,
    /// The value at `to`.
    pub(super) high: f64,
    /// Where the axis begins, SVG units.
    from: f64,
    /// Where it ends, SVG units.
    to: f64,
    /// Whether it is logarithmic; `low` is above 0 then.
    pub(super) log: bool,
    /// Whether all values are 0.
    empty: bool,
    /// The largest value; above `high` where the axis is cut off.
    pub(super) largest: f64,
}

impl Axis {
    /// A linear axis of the values `low` to `high`, from one position to the other.
    pub(super) fn linear(low: f64, high: f64, (from, to): (f64, f64)) -> Self {
        let high = if high > low { high } else { low + 1.0 };
        Self { low, high, from, to, log: false, empty: false, largest: high }
    }

    /// A logarithmic axis with a margin around the values `low` (above 0) to `high`.
    fn logarithmic(low: f64, high: f64, (from, to): (f64, f64)) -> Self {
        Self { low: low * 0.8, high: high * 1.25, from, to, log: true, empty: false, largest: high }
    }

    /// The horizontal axis of quantities: from 0, or logarithmic where they differ widely.
    pub(super) fn of_quantities(low: f64, high: f64, range: (f64, f64)) -> Self {
        if low > 0.0 && high > LOG_X_ABOVE * low {
            Self::logarithmic(low, high, range)
        } else {
            Self::linear(0.0, if high > 0.0 { high * 1.08 } else { 1.0 }, range)
        }
    }

    /// The vertical axis of values from 0. It is logarithmic if a few values are far above the rest, and none
    /// is 0. Stacked areas have no logarithm: their axis is cut off above most of the values.
    pub(super) fn of_values(values: &mut [f64], stacked: bool, range: (f64, f64)) -> Self {
        values.sort_by(f64::total_cmp);
        let (low, high) = (values.first().copied().unwrap_or(0.0), values.last().copied().unwrap_or(1.0));
        let median = values.get(values.len() / 2).copied().unwrap_or(1.0);
        let spike = high > LOG_ABOVE * median;
        if spike && !stacked && low > 0.0 {
            Self::logarithmic(low, high, range)
        } else if spike && stacked && median > 0.0 {
            let most = values.get(values.len() * 95 / 100).copied().unwrap_or(high);
            Self { largest: high, ..Self::linear(0.0, most * 1.3, range) }
        } else if high > 0.0 {
            Self::linear(0.0, high * 1.06, range)
        } else {
            Self { empty: true, ..Self::linear(0.0, 1.0, range) }
        }
    }

    /// The position of a value, SVG units.
    pub(super) fn at(&self, value: f64) -> f64 {
        let share = if self.log {
            (value.max(self.low) / self.low).log10() / (self.high / self.low).log10()
        } else {
            (value.min(self.high) - self.low) / (self.high - self.low)
        };
        self.from + share * (self.to - self.from)
    }

    /// About this many round values, for labels of the axis.
    pub(super) fn ticks(&self, about: f64) -> Vec<f64> {
        if self.log {
            let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
            let steps: &[f64] = if last - first <= 3 { &[1.0, 2.0, 5.0] } else { &[1.0] };
            let all = (first..=last).flat_map(|d| steps.iter().map(move |s| s * 10_f64.powi(d)));
            return all.filter(|t| (self.low..=self.high).contains(t)).collect();
        }
        // If all values are 0, lines between 0 and the top would say nothing.
        let step = if self.empty { self.high } else { round_step((self.high - self.low) / about) };
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// The smallest of 1, 2, 5 times a power of ten that is at least `raw`.
fn round_step(raw: f64) -> f64 {
    let power = 10_f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&s| s >= raw * 0.999).unwrap_or(raw)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_one_two_or_five() {
        for (raw, step) in [(0.9, 1.0), (1.0, 1.0), (1.3, 2.0), (2.1, 5.0), (51.0, 100.0), (0.03, 0.05)] {
            assert!((round_step(raw) - step).abs() < 1e-9, "{raw}");
        }
    }

    #[test]
    fn a_spike_makes_the_axis_logarithmic_unless_a_value_is_zero() {
        let axis = |low, stacked| {
            let mut values = [[5000.0, low], [low, low]].concat();
            Axis::of_values(&mut values, stacked, (0.0, 1.0))
        };
        assert!(axis(10.0, false).log);
        assert!(!axis(0.0, false).log);
        let cut_off = axis(10.0, true);
        assert!(!cut_off.log);
        assert_eq!((cut_off.largest, axis(5000.0, true).largest), (5000.0, 5300.0));
    }
}
