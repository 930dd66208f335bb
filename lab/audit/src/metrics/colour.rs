//! Comparison of images by colour.

use trimaran_cull::ImageDifference;

use super::image::same_size;
use super::{Deviation, ImageRef, MetricError};

/// The FLIP error of every pixel: 0 (looks equal) to 1, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct FlipMap {
    values: Vec<f32>,
}

impl FlipMap {
    /// The error of every pixel.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The mean, which FLIP's authors recommend if one figure must do.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.values.iter().map(|&v| f64::from(v)).sum::<f64>() / self.values.len() as f64
    }

    /// The nearest-rank percentile, for `percent` from 1 to 100.
    #[must_use]
    pub fn percentile(&self, percent: usize) -> f64 {
        let mut values = self.values.clone();
        let rank = (percent * values.len()).div_ceil(100).clamp(1, values.len());
        f64::from(*values.select_nth_unstable_by(rank - 1, f32::total_cmp).1)
    }
}

/// The number of pixels whose red, green or blue differs.
///
/// # Errors
/// If the images differ in size.
pub fn mismatching_pixels(a: &ImageRef<'_>, b: &ImageRef<'_>) -> Result<u64, MetricError> {
    same_size(a.size(), b.size())?;
    let differs = |(a, b): &(&[u8; 4], &[u8; 4])| a[..3] != b[..3];
    Ok(a.pixels().iter().zip(b.pixels()).filter(differs).count() as u64)
}

/// The peak signal-to-noise ratio over red, green and blue in decibels: 10 log10(255^2 / mean squared
/// difference). `None` if the images are equal, where it is infinite.
///
/// # Errors
/// If the images differ in size.
pub fn psnr_db(a: &ImageRef<'_>, b: &ImageRef<'_>) -> Result<Option<f64>, MetricError> {
    same_size(a.size(), b.size())?;
    let squares: u64 = a
        .pixels()
        .iter()
        .zip(b.pixels())
        .flat_map(|(a, b)| a.iter().zip(b).take(3))
        .map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2))
        .sum();
    let mean = squares as f64 / (3 * a.pixels().len()) as f64;
    Ok((squares > 0).then(|| 10.0 * (255.0_f64.powi(2) / mean).log10()))
}

/// The FLIP error map of `image` against `reference` (Andersson et al., "FLIP: a difference evaluator for
/// alternating images", 2020), at the authors' default of 67 pixels a degree of the viewer's field.
///
/// # Errors
/// If the images differ in size.
pub fn flip(reference: &ImageRef<'_>, image: &ImageRef<'_>) -> Result<FlipMap, MetricError> {
    same_size(reference.size(), image.size())?;
    if mismatching_pixels(reference, image)? == 0 {
        return Ok(FlipMap { values: vec![0.0; reference.pixels().len()] });
    }
    let (width, height) = reference.size();
    let rgb =
        |p: &ImageRef<'_>| -> Vec<u8> { p.pixels().iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect() };
    let rgb_of = |p| nv_flip::FlipImageRgb8::with_data(width, height, &rgb(p));
    let map = nv_flip::flip(rgb_of(reference), rgb_of(image), nv_flip::DEFAULT_PIXELS_PER_DEGREE);
    Ok(FlipMap { values: map.to_vec() })
}

/// `image` against `reference` by colour, combined with the given deviations.
///
/// # Errors
/// If they differ in size.
pub fn image_difference(
    reference: &ImageRef<'_>,
    image: &ImageRef<'_>,
    silhouette: Deviation,
    surfaces: Deviation,
) -> Result<ImageDifference, MetricError> {
    let map = flip(reference, image)?;
    Ok(ImageDifference {
        psnr_db: psnr_db(reference, image)?,
        flip_mean: Some(map.mean()),
        flip_p99: Some(map.percentile(99)),
        mismatching_pixels: mismatching_pixels(reference, image)?,
        silhouette_max_px: Some(silhouette.max_px),
        silhouette_p95_px: Some(silhouette.p95_px),
        surface_max_px: Some(surfaces.max_px),
        surface_p95_px: Some(surfaces.p95_px),
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn grey(width: u32, values: &[u8]) -> Vec<u8> {
        assert_eq!(values.len() % width as usize, 0);
        values.iter().flat_map(|&v| [v, v, v, 255]).collect()
    }

    fn checked(width: u32, rgba: &[u8]) -> ImageRef<'_> {
        ImageRef::new(width, rgba.len() as u32 / 4 / width, rgba).unwrap()
    }

    #[test]
    fn equal_pictures_have_no_finite_psnr_and_no_error() {
        let rgba = grey(2, &[1, 2, 3, 4]);
        let picture = checked(2, &rgba);
        assert_eq!(psnr_db(&picture, &picture), Ok(None));
        assert_eq!(mismatching_pixels(&picture, &picture), Ok(0));
        let map = flip(&picture, &picture).unwrap();
        assert_eq!((map.mean(), map.percentile(99)), (0.0, 0.0));
    }

    #[test]
    fn psnr_of_black_against_white_is_zero() {
        let (black, white) = (grey(2, &[0; 4]), grey(2, &[255; 4]));
        assert_eq!(psnr_db(&checked(2, &black), &checked(2, &white)), Ok(Some(0.0)));
    }

    #[test]
    fn psnr_of_one_step_everywhere_is_20_log_255() {
        let (a, b) = (grey(2, &[100; 4]), grey(2, &[101; 4]));
        let db = psnr_db(&checked(2, &a), &checked(2, &b)).unwrap().unwrap();
        assert!((db - 48.130_803_608_679_1).abs() < 1e-12, "{db}");
    }

    #[test]
    fn alpha_is_ignored() {
        let (a, b) = ([9, 9, 9, 0], [9, 9, 9, 255]);
        assert_eq!(mismatching_pixels(&checked(1, &a), &checked(1, &b)), Ok(0));
        assert_eq!(psnr_db(&checked(1, &a), &checked(1, &b)), Ok(None));
    }

    #[test]
    fn flip_finds_the_wrong_place() {
        let plain = grey(32, &[128; 32 * 32]);
        let mut spotted = plain.clone();
        for y in 4..8 {
            for x in 4..8 {
                let at = 4 * (y * 32 + x);
                spotted[at..at + 3].copy_from_slice(&[255, 0, 0]);
            }
        }
        let map = flip(&checked(32, &plain), &checked(32, &spotted)).unwrap();
        let (worst, value) = map.values().iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        assert!((4..8).contains(&(worst % 32)) && (4..8).contains(&(worst / 32)), "{worst}");
        assert!(*value > 0.3, "{value}");
        assert!(map.mean() > 0.0 && map.mean() < 0.2, "{}", map.mean());
        assert!(map.percentile(100) >= map.percentile(99));
        assert_eq!(map.percentile(50), 0.0);
    }

    #[test]
    fn flip_takes_a_picture_of_one_pixel() {
        let map = flip(&checked(1, &[0, 0, 0, 255]), &checked(1, &[255, 255, 255, 255])).unwrap();
        assert!(map.mean() > 0.9 && map.mean() <= 1.0, "{}", map.mean());
    }

    #[test]
    fn sizes_must_agree() {
        let (a, b) = (grey(2, &[0; 4]), grey(4, &[0; 4]));
        let differ = MetricError::Differ { left: (2, 2), right: (4, 1) };
        assert_eq!(psnr_db(&checked(2, &a), &checked(4, &b)), Err(differ.clone()));
        assert_eq!(flip(&checked(2, &a), &checked(4, &b)), Err(differ));
    }

    proptest! {
        #[test]
        fn psnr_and_mismatches_agree_with_the_definition(
            pairs in prop::collection::vec(any::<([u8; 4], [u8; 4])>(), 1..30)
        ) {
            let (a, b): (Vec<[u8; 4]>, Vec<[u8; 4]>) = pairs.iter().copied().unzip();
            let (a, b) = (a.concat(), b.concat());
            let (a, b) = (checked(1, &a), checked(1, &b));
            let mut squares = 0.0;
            let mut wrong = 0;
            for (left, right) in &pairs {
                wrong += u64::from((0..3).any(|c| left[c] != right[c]));
                squares += (0..3).map(|c| (f64::from(left[c]) - f64::from(right[c])).powi(2)).sum::<f64>();
            }
            prop_assert_eq!(mismatching_pixels(&a, &b), Ok(wrong));
            match psnr_db(&a, &b).unwrap() {
                None => prop_assert_eq!(wrong, 0),
                Some(db) => {
                    let mean = squares / (3 * pairs.len()) as f64;
                    prop_assert!((db - 10.0 * (65025.0 / mean).log10()).abs() < 1e-9);
                }
            }
        }
    }
}
