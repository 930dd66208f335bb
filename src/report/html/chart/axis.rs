//! From values to places in a drawing.

use super::{BOTTOM, TOP};

/// An axis is logarithmic where the largest value is this many times the median.
const LOG_ABOVE: f64 = 6.0;

/// A map from values to SVG units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) log: bool,
    /// All values are 0.
    pub(super) empty: bool,
    /// The largest value; above `high` where the axis is cut off.
    pub(super) largest: f64,
}

impl Axis {
    pub(super) fn linear(low: f64, high: f64, from: f64, to: f64) -> Self {
        let high = if high > low { high } else { low + 1.0 };
        Self { low, high, from, to, log: false, empty: false, largest: high }
    }

    /// The axis of values from 0: logarithmic where single values stand far above the rest, and none is 0.
    pub(super) fn of_values(values: &mut [f64], may_be_log: bool) -> Self {
        values.sort_by(f64::total_cmp);
        let (low, high) = (values.first().copied().unwrap_or(0.0), values.last().copied().unwrap_or(1.0));
        let median = values.get(values.len() / 2).copied().unwrap_or(1.0);
        if may_be_log && low > 0.0 && high > LOG_ABOVE * median {
            return Self {
                low: low * 0.8,
                high: high * 1.25,
                from: BOTTOM,
                to: TOP,
                log: true,
                empty: false,
                largest: high,
            };
        }
        // An area has no logarithm: it is cut off above what most values need.
        let most = values.get(values.len() * 95 / 100).copied().unwrap_or(high);
        if !may_be_log && median > 0.0 && high > LOG_ABOVE * median {
            return Self { largest: high, ..Self::linear(0.0, most * 1.3, BOTTOM, TOP) };
        }
        if high > 0.0 {
            Self::linear(0.0, high * 1.06, BOTTOM, TOP)
        } else {
            Self { empty: true, ..Self::linear(0.0, 1.0, BOTTOM, TOP) }
        }
    }

    pub(super) fn at(&self, value: f64) -> f64 {
        let share = if self.log {
            (value.max(self.low) / self.low).log10() / (self.high / self.low).log10()
        } else {
            (value.min(self.high) - self.low) / (self.high - self.low)
        };
        self.from + share * (self.to - self.from)
    }

    pub(super) fn ticks(&self, about: f64) -> Vec<f64> {
        if self.log {
            let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
            let steps: &[f64] = if last - first <= 3 { &[1.0, 2.0, 5.0] } else { &[1.0] };
            let all = (first..=last).flat_map(|d| steps.iter().map(move |s| s * 10_f64.powi(d)));
            return all.filter(|t| (self.low..=self.high).contains(t)).collect();
        }
        // Where all values are 0, nothing but 0 is worth a line.
        let step = if self.empty { self.high } else { nice_step((self.high - self.low) / about) };
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// The smallest of 1, 2, 5 times a power of ten that is at least `raw`.
pub(in crate::report::html) fn nice_step(raw: f64) -> f64 {
    let power = 10_f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&s| s >= raw * 0.999).unwrap_or(raw)
}
