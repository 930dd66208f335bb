//! How a figure spreads over the frames of a run.

use serde::{Deserialize, Serialize};

use super::Frame;

/// How a figure spreads over the frames on which it was measured. Percentiles are nearest-rank: the smallest
/// measured value that at least that share of the values does not exceed, so every figure here occurred.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stat {
    /// Frames on which it was measured.
    pub frames: u32,
    /// The 50th percentile.
    pub median: f64,
    /// The 95th percentile.
    pub p95: f64,
    /// The largest.
    pub max: f64,
}

impl Stat {
    /// The spread of `values`; `None` if there are none. Values that are not finite are left out.
    #[must_use]
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let &max = values.last()?;
        Some(Self {
            frames: u32::try_from(values.len()).unwrap_or(u32::MAX),
            median: nearest_rank(&values, 50)?,
            p95: nearest_rank(&values, 95)?,
            max,
        })
    }
}

/// How a figure spreads that is worst where it is lowest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LowStat {
    /// Frames on which it was measured, and finite.
    pub frames: u32,
    /// Frames on which it was infinite: pictures that are equal. They are not in the figures below.
    pub infinite: u32,
    /// The 50th percentile.
    pub median: Option<f64>,
    /// The 5th percentile.
    pub p5: Option<f64>,
    /// The smallest.
    pub min: Option<f64>,
}

impl LowStat {
    pub(super) fn of_psnr(frames: &[Frame]) -> Option<Self> {
        let errors: Vec<_> = frames.iter().filter_map(|f| f.full_detail).collect();
        let mut values: Vec<f64> =
            errors.iter().filter_map(|e| e.psnr_db).filter(|v| v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let equal = errors.iter().filter(|e| e.mismatching_pixels == 0).count();
        (!errors.is_empty()).then(|| Self {
            frames: u32::try_from(values.len()).unwrap_or(u32::MAX),
            infinite: u32::try_from(equal).unwrap_or(u32::MAX),
            median: nearest_rank(&values, 50),
            p5: nearest_rank(&values, 5),
            min: values.first().copied(),
        })
    }
}

/// The nearest-rank percentile of sorted values.
fn nearest_rank(sorted: &[f64], percent: usize) -> Option<f64> {
    let rank = (percent * sorted.len()).div_ceil(100).max(1);
    sorted.get(rank - 1).copied()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::report::schema::ImageDifference;

    #[test]
    fn percentiles_are_nearest_rank() {
        let of = |values: &[f64]| Stat::of(values.iter().copied()).unwrap();
        let hundred: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!(of(&hundred), Stat { frames: 100, median: 50.0, p95: 95.0, max: 100.0 });
        assert_eq!(of(&[7.0]), Stat { frames: 1, median: 7.0, p95: 7.0, max: 7.0 });
        assert_eq!(of(&[1.0, 2.0]), Stat { frames: 2, median: 1.0, p95: 2.0, max: 2.0 });
        assert_eq!(of(&[f64::NAN, 1.0, f64::INFINITY]).frames, 1);
        assert_eq!(Stat::of([]), None);
    }

    #[test]
    fn equal_pictures_count_as_infinite_psnr() {
        let error = |psnr_db, mismatching_pixels| Frame {
            full_detail: Some(ImageDifference {
                psnr_db,
                flip_mean: None,
                flip_p99: None,
                mismatching_pixels,
                silhouette_max_px: None,
                silhouette_p95_px: None,
                surface_max_px: None,
                surface_p95_px: None,
            }),
            ..Frame::default()
        };
        let frames = [error(Some(40.0), 9), error(None, 0), error(Some(30.0), 90)];
        let psnr = LowStat::of_psnr(&frames).unwrap();
        let expected =
            LowStat { frames: 2, infinite: 1, median: Some(30.0), p5: Some(30.0), min: Some(30.0) };
        assert_eq!(psnr, expected);
    }

    proptest! {
        #[test]
        fn a_percentile_is_the_smallest_value_that_enough_do_not_exceed(
            mut values in prop::collection::vec(-1e6..1e6_f64, 1..60),
            percent in 1_usize..=100,
        ) {
            values.sort_by(f64::total_cmp);
            let found = nearest_rank(&values, percent).unwrap();
            let enough = |limit: f64| 100 * values.iter().filter(|&&v| v <= limit).count() >= percent * values.len();
            prop_assert!(enough(found));
            prop_assert!(values.iter().filter(|&&v| v < found).all(|&v| !enough(v)));
        }
    }
}
