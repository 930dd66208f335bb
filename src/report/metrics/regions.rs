//! How far the outlines between things moved, where no background shows.
//!
//! Inside a plant every pixel is covered and the silhouette against the background says nothing. **Definition:** at every pixel
//! whose owner differs between two item images, the distance, centre to centre, to the nearest pixel that has this owner in the
//! other image; both ways. A region that is nowhere within [`MAX_REGION_SHIFT_PX`] counts as unmatched.
//!
//! Epsilon does not bound this: two surfaces in front that each move by epsilon can open or close a gap, and what shows through
//! it comes and goes as a whole.

use super::image::same_size;
use super::{ItemImage, MetricError, exactly_visible};
use crate::report::schema::RegionDeviation;

/// How far a region is looked for, pixels.
pub const MAX_REGION_SHIFT_PX: u32 = 32;

/// The deviation between two item images whose ids mean the same things. The background is a region like any other.
///
/// # Errors
/// If they differ in size.
pub fn region_deviation(a: &ItemImage<'_>, b: &ItemImage<'_>) -> Result<RegionDeviation, MetricError> {
    same_size(a.size(), b.size())?;
    let (a, b) = (Regions::of(a), Regions::of(b));
    let differing: Vec<usize> = (0..a.owners.len()).filter(|&p| a.owners[p] != b.owners[p]).collect();
    let search = |from: &Regions, to: &Regions| -> Vec<Option<u64>> {
        differing.iter().map(|&p| to.nearest(p, from.owners[p])).collect()
    };
    let found = [search(&a, &b), search(&b, &a)].concat();
    let mut matched: Vec<u64> = found.iter().copied().flatten().collect();
    matched.sort_unstable();
    let root = |squared: Option<&u64>| squared.map_or(0.0, |&s| (s as f64).sqrt());
    Ok(RegionDeviation {
        differing_pixels: differing.len() as u64,
        unmatched_pixels: (found.len() - matched.len()) as u64,
        max_px: root(matched.last()),
        p95_px: root(matched.get((95 * matched.len()).div_ceil(100).saturating_sub(1))),
    })
}

/// The owners of an image, and which there are.
struct Regions {
    width: usize,
    owners: Vec<Option<u32>>,
    visible: Vec<u32>,
}

impl Regions {
    fn of(image: &ItemImage<'_>) -> Self {
        Self {
            width: image.size().0 as usize,
            owners: image.owners().collect(),
            visible: exactly_visible(image),
        }
    }

    /// The squared distance from a pixel to the nearest one of `owner`, if it is within [`MAX_REGION_SHIFT_PX`]. Looks at
    /// squares of growing size, and stops when no larger one can be nearer.
    fn nearest(&self, pixel: usize, owner: Option<u32>) -> Option<u64> {
        if owner.is_some_and(|id| self.visible.binary_search(&id).is_err()) {
            return None;
        }
        let limit = i64::from(MAX_REGION_SHIFT_PX);
        let mut best: Option<i64> = None;
        for ring in 0..=limit {
            if best.is_some_and(|found| found <= ring * ring) {
                break;
            }
            for (dx, dy) in square(ring) {
                let squared = dx * dx + dy * dy;
                if squared <= limit * limit
                    && best.is_none_or(|found| squared < found)
                    && self.owner_at(pixel, dx, dy) == Some(owner)
                {
                    best = Some(squared);
                }
            }
        }
        best.map(i64::unsigned_abs)
    }

    /// The owner of the pixel at an offset; `None` outside of the picture.
    fn owner_at(&self, pixel: usize, dx: i64, dy: i64) -> Option<Option<u32>> {
        let x = (pixel % self.width).checked_add_signed(isize::try_from(dx).ok()?)?;
        let y = (pixel / self.width).checked_add_signed(isize::try_from(dy).ok()?)?;
        if x < self.width { self.owners.get(y * self.width + x).copied() } else { None }
    }
}

/// The offsets at a Chebyshev distance of `ring`.
fn square(ring: i64) -> impl Iterator<Item = (i64, i64)> {
    let sides = (-ring..=ring).flat_map(move |i| [(i, -ring), (i, ring), (-ring, i), (ring, i)]);
    sides.take(if ring == 0 { 1 } else { usize::MAX })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const NONE: u32 = u32::MAX;

    fn image(width: u32, ids: &[u32]) -> ItemImage<'_> {
        ItemImage::new(width, ids.len() as u32 / width, ids, NONE).unwrap()
    }

    #[test]
    fn an_edge_that_moved_by_two() {
        let found = region_deviation(&image(6, &[1, 1, 1, 2, 2, 2]), &image(6, &[1, 2, 2, 2, 2, 2])).unwrap();
        let expected = RegionDeviation { differing_pixels: 2, unmatched_pixels: 0, max_px: 2.0, p95_px: 2.0 };
        assert_eq!(found, expected);
    }

    #[test]
    fn a_region_that_vanished_is_unmatched() {
        let found = region_deviation(&image(4, &[1, 3, 1, 1]), &image(4, &[1, 1, 1, 1])).unwrap();
        assert_eq!((found.differing_pixels, found.unmatched_pixels, found.max_px), (1, 1, 1.0));
    }

    #[test]
    fn a_region_too_far_away_is_unmatched() {
        let (mut a, mut b) = ([NONE; 100], [NONE; 100]);
        (a[0], b[33]) = (5, 5);
        assert_eq!(region_deviation(&image(100, &a), &image(100, &b)).unwrap().unmatched_pixels, 2);
        (b[33], b[32]) = (NONE, 5);
        let near = region_deviation(&image(100, &a), &image(100, &b)).unwrap();
        assert_eq!((near.unmatched_pixels, near.max_px), (0, 32.0));
    }

    #[test]
    fn equal_images_do_not_deviate() {
        let ids = image(2, &[1, NONE, 2, 2]);
        assert_eq!(region_deviation(&ids, &ids), Ok(RegionDeviation::default()));
    }

    proptest! {
        #[test]
        fn agrees_with_brute_force(
            (width, a, b) in (1_usize..10, 1_usize..10).prop_flat_map(|(w, h)| {
                let ids = prop::collection::vec(prop_oneof![0_u32..4, Just(NONE)], w * h);
                (Just(w), ids.clone(), ids)
            })
        ) {
            let nearest = |p: usize, id: u32, other: &[u32]| {
                (0..other.len())
                    .filter(|&q| other[q] == id)
                    .map(|q| (p % width).abs_diff(q % width).pow(2) + (p / width).abs_diff(q / width).pow(2))
                    .min()
            };
            let differing: Vec<usize> = (0..a.len()).filter(|&p| a[p] != b[p]).collect();
            let found: Vec<Option<usize>> =
                differing.iter().flat_map(|&p| [nearest(p, a[p], &b), nearest(p, b[p], &a)]).collect();
            let mut matched: Vec<usize> = found.iter().copied().flatten().collect();
            matched.sort_unstable();
            let result = region_deviation(&image(width as u32, &a), &image(width as u32, &b)).unwrap();
            prop_assert_eq!(result.differing_pixels, differing.len() as u64);
            prop_assert_eq!(result.unmatched_pixels, (found.len() - matched.len()) as u64);
            let root = |i: usize| (matched[i] as f64).sqrt();
            if !matched.is_empty() {
                prop_assert_eq!(result.max_px, root(matched.len() - 1));
                prop_assert_eq!(result.p95_px, root((95 * matched.len()).div_ceil(100) - 1));
            }
        }
    }
}
