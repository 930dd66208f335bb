//! The deviation of pixels from their correct place, in two figures.
//!
//! The caller defines the distances; this module defines which pixels count. For the *silhouette* those are
//! the pixels covered by only one of the pictures. The 95th percentile also includes the outline pixels of
//! both: covered pixels with an uncovered one above, below, left or right. Their distance is 0 if both
//! pictures cover them.

use super::image::same_size;
use super::{Mask, MetricError};

/// The deviation of pixels from their correct place, in pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Deviation {
    /// The largest distance; 0 if nothing was measured.
    pub max_px: f64,
    /// The 95th percentile, nearest rank; 0 if nothing was measured.
    pub p95_px: f64,
}

impl Deviation {
    /// The deviation of pixels at `distances`, besides `zeros` pixels at distance 0.
    #[must_use]
    pub fn of(mut distances: Vec<f64>, zeros: usize) -> Self {
        distances.sort_unstable_by(f64::total_cmp);
        let rank = (95 * (distances.len() + zeros)).div_ceil(100);
        let p95 = rank.checked_sub(zeros + 1).and_then(|at| distances.get(at));
        Self { max_px: distances.last().copied().unwrap_or(0.0), p95_px: p95.copied().unwrap_or(0.0) }
    }
}

/// How far the border between covered pixels and the background moved from `a` to `b`. `from_a` measures
/// pixels (indices, row by row) that only `a` covers, `from_b` those that only `b` covers: their distances in
/// the same order. `None` for one without a counterpart counts as the pictures' diagonal.
///
/// # Errors
/// If the masks differ in size.
pub fn silhouette(
    a: &Mask,
    b: &Mask,
    from_a: impl FnOnce(&[usize]) -> Vec<Option<f64>>,
    from_b: impl FnOnce(&[usize]) -> Vec<Option<f64>>,
) -> Result<Deviation, MetricError> {
    same_size(a.size(), b.size())?;
    let diagonal = a.diagonal();
    let (only_a, only_b) = (without(a, b), without(b, a));
    let measured = [from_a(&only_a), from_b(&only_b)].concat();
    let distances = measured.into_iter().map(|distance| distance.unwrap_or(diagonal)).collect();
    let (a_covers, b_covers) = (a.covered(), b.covered());
    let shared = outline(a).filter(|&p| b_covers[p]).count() + outline(b).filter(|&p| a_covers[p]).count();
    Ok(Deviation::of(distances, shared))
}

/// The pixels covered by `mask` and not by `other`, of the same size.
fn without(mask: &Mask, other: &Mask) -> Vec<usize> {
    let pairs = mask.covered().iter().zip(other.covered()).enumerate();
    pairs.filter(|(_, (here, there))| **here && !**there).map(|(pixel, _)| pixel).collect()
}

/// The covered pixels with an uncovered one above, below, left or right. The picture's own edge is no
/// outline.
fn outline(mask: &Mask) -> impl Iterator<Item = usize> + '_ {
    let (width, height, covered) = (mask.width(), mask.height(), mask.covered());
    (0..covered.len()).filter(move |&p| {
        let (x, y) = (p % width, p / width);
        covered[p]
            && ((x > 0 && !covered[p - 1])
                || (x + 1 < width && !covered[p + 1])
                || (y > 0 && !covered[p - width])
                || (y + 1 < height && !covered[p + width]))
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::image::mask;
    use super::*;

    #[test]
    fn only_what_one_picture_covers_is_measured() {
        let (a, b) = (mask(6, "###... ###... ......"), mask(6, ".####. .####. ......"));
        let mut asked = Vec::new();
        let found = silhouette(
            &a,
            &b,
            |pixels| {
                asked.extend_from_slice(pixels);
                vec![Some(1.25); pixels.len()]
            },
            |pixels| pixels.iter().map(|&p| Some((p % 6) as f64)).collect(),
        );
        assert_eq!(asked, [0, 6]);
        assert_eq!(found, Ok(Deviation { max_px: 4.0, p95_px: 4.0 }));
    }

    #[test]
    fn outline_pixels_that_both_cover_count_as_zero() {
        // 40 pixels in a row, of which one picture lacks the first: all outline, and one of them 3 pixels
        // off.
        let row = |covered: &str| mask(40, &(covered.to_owned() + &".".repeat(40)));
        let (a, b) = (row(&"#".repeat(40)), row(&(".".to_owned() + &"#".repeat(39))));
        let found = silhouette(&a, &b, |pixels| vec![Some(3.0); pixels.len()], |_| Vec::new()).unwrap();
        assert_eq!(found, Deviation { max_px: 3.0, p95_px: 0.0 });
    }

    #[test]
    fn a_pixel_that_belongs_nowhere_is_a_diagonal_off() {
        let (empty, dot) = (mask(3, "... ... ... ..."), mask(3, "... .#. ... ..."));
        let nowhere = |pixels: &[usize]| vec![None; pixels.len()];
        assert_eq!(silhouette(&dot, &empty, nowhere, nowhere).unwrap().max_px, 5.0, "the diagonal of 3 x 4");
        assert_eq!(silhouette(&dot, &dot, nowhere, nowhere), Ok(Deviation::default()));
    }

    #[test]
    fn sizes_must_agree() {
        let nothing = |_: &[usize]| Vec::new();
        assert!(silhouette(&mask(3, "... ..."), &mask(2, ".. .. .."), nothing, nothing).is_err());
    }

    #[test]
    fn the_pictures_edge_is_no_outline() {
        assert_eq!(outline(&mask(3, "### ###")).count(), 0);
        assert_eq!(outline(&mask(3, "##. ##.")).collect::<Vec<_>>(), [1, 4]);
    }

    proptest! {
        #[test]
        fn zeros_count_as_if_they_were_listed(
            distances in prop::collection::vec(0.0..9.0_f64, 0..40), zeros in 0_usize..40
        ) {
            let listed = [vec![0.0; zeros], distances.clone()].concat();
            let (mut sorted, count) = (listed.clone(), listed.len());
            sorted.sort_by(f64::total_cmp);
            let found = Deviation::of(distances, zeros);
            prop_assert_eq!(found, Deviation::of(listed, 0));
            if count > 0 {
                prop_assert_eq!(found.p95_px, sorted[(95 * count).div_ceil(100) - 1]);
                prop_assert_eq!(found.max_px, sorted[count - 1]);
            }
        }
    }
}
