//! Statistics of many values.

use std::ops::Add;

use serde::Serialize;

/// A distribution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Percentiles {
    /// Half are at most this.
    pub p50: f64,
    /// 95 % are at most this.
    pub p95: f64,
    /// 99 % are at most this.
    pub p99: f64,
    /// 99.9 % are at most this.
    pub p999: f64,
    /// The mean.
    pub mean: f64,
}

/// The mean over sessions, and the standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The standard deviation; none for a single session.
    pub deviation: Option<f64>,
}

impl Spread {
    /// Of these values; none if there are none.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let deviation = (values.len() > 1).then(|| (squares / (count - 1.0)).sqrt());
        (!values.is_empty()).then_some(Self { mean, deviation })
    }
}

impl Percentiles {
    pub(super) fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        // The smallest value that this share of values does not exceed.
        let at = |share: f64| {
            let rank = (share * values.len() as f64).ceil() as usize;
            values.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        Self { p50: at(0.5), p95: at(0.95), p99: at(0.99), p999: at(0.999), mean }
    }
}

/// The effect of gaps on the pictures of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PixelCost {
    /// How many frames were shown.
    pub frames: u32,
    /// How many had a pixel that differs from the picture without loss.
    pub frames_wrong: u32,
    /// The number of such pixels, over all frames.
    pub wrong_pixels: u64,
    /// The most in a frame.
    pub worst: u64,
    /// Triangles drawn needlessly, over all frames: the frame before had them, and it is unknown which ids
    /// were lost.
    pub needless_triangles: u64,
}

impl Add for PixelCost {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            frames: self.frames + other.frames,
            frames_wrong: self.frames_wrong + other.frames_wrong,
            wrong_pixels: self.wrong_pixels + other.wrong_pixels,
            worst: self.worst.max(other.worst),
            needless_triangles: self.needless_triangles + other.needless_triangles,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values_that_occurred() {
        let values = (1..=1000).rev().map(f64::from).collect();
        let expected = Percentiles { p50: 500.0, p95: 950.0, p99: 990.0, p999: 999.0, mean: 500.5 };
        assert_eq!(Percentiles::of(values), expected);
        assert_eq!(Percentiles::of(vec![7.0]).p999, 7.0);
        assert_eq!(Percentiles::of(Vec::new()).p50, 0.0);
    }

    #[test]
    fn values_are_spread_around_their_mean() {
        assert_eq!(
            Spread::of(&[2.0, 4.0, 9.0]),
            Some(Spread { mean: 5.0, deviation: Some(13.0_f64.sqrt()) })
        );
        assert_eq!(Spread::of(&[7.0]), Some(Spread { mean: 7.0, deviation: None }));
        assert_eq!(Spread::of(&[]), None);
    }
}
