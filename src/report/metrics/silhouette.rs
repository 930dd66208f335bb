//! How far the outline of what is covered moved.
//!
//! **Definition.** Let A and B be the pixels that two pictures cover. The deviation of a pixel of A is its distance, centre to
//! centre, to the nearest pixel of B (0 if B covers it too), and the other way round. The *largest* is taken over all pixels of
//! both: the two-sided Hausdorff distance of the covered sets. The *95th percentile* (nearest-rank) is taken over the outline
//! pixels of both: covered pixels with an uncovered one above, below, left or right.
//!
//! **Why not outline to outline.** A level of detail whose surface lies within epsilon of the finest may close a hole
//! narrower than 2 epsilon. The pixels of the closed hole are then within epsilon of what the finest covers, which is what was
//! promised; but the hole's outline has no partner, and the nearest other outline may be anywhere.
//!
//! **Sampling.** A pixel is covered if its centre is. That alone moves an edge by up to [`SAMPLING_SLACK_PX`] at either
//! picture, so a deviation of epsilon plus that much can still be epsilon on the surface. Parts thinner than a pixel may miss
//! every centre, and then the distance is to whatever is covered nearby.
//!
//! Distances are exact (Meijster, Roerdink, Hesselink: "A general algorithm for computing distance transforms in linear
//! time", 2000).

use super::image::same_size;
use super::{Mask, MetricError};

/// Half the diagonal of a pixel: how far a covered pixel's centre may lie from the nearest covered point.
pub const SAMPLING_SLACK_PX: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// How far the outline of what is covered moved, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Silhouette {
    /// The largest deviation. If only one picture covers anything: the pictures' diagonal, which no distance exceeds.
    pub max_px: f64,
    /// The 95th percentile over the outline pixels of both; 0 if there are none.
    pub p95_px: f64,
}

/// The deviation between what two pictures cover.
///
/// # Errors
/// If they differ in size.
pub fn silhouette(a: &Mask, b: &Mask) -> Result<Silhouette, MetricError> {
    same_size(a.size(), b.size())?;
    if a == b {
        return Ok(Silhouette { max_px: 0.0, p95_px: 0.0 });
    }
    let (to_a, to_b) = (squared_distances(a), squared_distances(b));
    let of = |mask: &Mask, to_other: &[u64]| -> u64 {
        mask.covered()
            .iter()
            .zip(to_other)
            .filter(|(covered, _)| **covered)
            .map(|(_, &d)| d)
            .max()
            .unwrap_or(0)
    };
    let mut outline: Vec<u64> = outline(a).map(|p| to_b[p]).chain(outline(b).map(|p| to_a[p])).collect();
    let p95 = match outline.len() {
        0 => 0,
        n => *outline.select_nth_unstable((95 * n).div_ceil(100) - 1).1,
    };
    let max = of(a, &to_b).max(of(b, &to_a));
    Ok(Silhouette { max_px: (max as f64).sqrt(), p95_px: (p95 as f64).sqrt() })
}

/// The covered pixels with an uncovered one above, below, left or right. The picture's own edge is no outline.
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

/// The squared distance from each pixel to the nearest covered one; the squared diagonal if none is covered.
fn squared_distances(mask: &Mask) -> Vec<u64> {
    let (width, height) = (mask.width(), mask.height());
    let far = (width as u64).pow(2) + (height as u64).pow(2);
    let down = distances_along_columns(mask);
    let mut squared = vec![far; width * height];
    let mut envelope = Envelope::default();
    for (row, out) in down.chunks(width).zip(squared.chunks_mut(width)) {
        envelope.lower(row, out);
    }
    squared
}

/// The distance from each pixel to the nearest covered one in its column; `None` if the column has none.
fn distances_along_columns(mask: &Mask) -> Vec<Option<u32>> {
    let (width, height, covered) = (mask.width(), mask.height(), mask.covered());
    let mut distance: Vec<Option<u32>> = covered.iter().map(|&c| c.then_some(0)).collect();
    let nearer = |near: Option<u32>, here: Option<u32>| match (near.map(|d| d + 1), here) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    };
    for p in width..width * height {
        distance[p] = nearer(distance[p - width], distance[p]);
    }
    for p in (0..width * (height - 1)).rev() {
        distance[p] = nearer(distance[p + width], distance[p]);
    }
    distance
}

/// The lower envelope of a row's parabolas (x - s)^2 + g(s)^2, one for each column s that has a covered pixel.
#[derive(Default)]
struct Envelope {
    /// The parabolas on the envelope, left to right: the column, the squared height, and the first x where it is lowest.
    parabolas: Vec<(i64, i64, i64)>,
}

impl Envelope {
    fn lower(&mut self, row: &[Option<u32>], out: &mut [u64]) {
        self.parabolas.clear();
        for (column, height) in (0_i64..).zip(row) {
            if let Some(height) = height {
                self.push(column, i64::from(*height).pow(2));
            }
        }
        let mut parabolas = self.parabolas.iter().peekable();
        let mut current = parabolas.next();
        for (x, out) in (0_i64..).zip(out) {
            while let Some(next) = parabolas.next_if(|next| next.2 <= x) {
                current = Some(next);
            }
            if let Some(&(column, height, _)) = current {
                *out = ((x - column).pow(2) + height).unsigned_abs();
            }
        }
    }

    fn push(&mut self, column: i64, height: i64) {
        let mut from = 0;
        while let Some(&(last, last_height, last_from)) = self.parabolas.last() {
            // The new parabola lies below the last one right of (column^2 - last^2 + height - last_height) / (2 (column - last)).
            let crossing = column.pow(2) - last.pow(2) + height - last_height;
            from = crossing.div_euclid(2 * (column - last)) + 1;
            if from > last_from {
                break;
            }
            self.parabolas.pop();
            from = 0;
        }
        self.parabolas.push((column, height, from));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn mask(width: u32, rows: &str) -> Mask {
        let covered: Vec<bool> = rows.chars().filter(|c| !c.is_whitespace()).map(|c| c == '#').collect();
        Mask::new(width, covered.len() as u32 / width, covered).unwrap()
    }

    #[test]
    fn a_shift_by_two_is_two() {
        let (a, b) = (mask(6, "##.... ##.... ......"), mask(6, "..##.. ..##.. ......"));
        assert_eq!(silhouette(&a, &b), Ok(Silhouette { max_px: 2.0, p95_px: 2.0 }));
    }

    #[test]
    fn a_closed_hole_counts_by_its_width_not_by_the_way_to_the_next_outline() {
        let (open, closed) =
            (mask(5, "##### ##### ##.## ##### #####"), mask(5, "##### ##### ##### ##### #####"));
        assert_eq!(silhouette(&open, &closed).unwrap().max_px, 1.0);
    }

    #[test]
    fn empty_masks() {
        let (empty, full) = (mask(3, "... ... ... ..."), mask(3, "### ### ### ###"));
        assert_eq!(silhouette(&empty, &empty), Ok(Silhouette { max_px: 0.0, p95_px: 0.0 }));
        assert_eq!(silhouette(&empty, &full).unwrap().max_px, 5.0, "the diagonal of 3 x 4");
        let dot = mask(3, "... .#. ... ...");
        assert_eq!(silhouette(&dot, &empty), Ok(Silhouette { max_px: 5.0, p95_px: 5.0 }));
    }

    #[test]
    fn the_pictures_edge_is_no_outline() {
        assert_eq!(outline(&mask(3, "### ###")).count(), 0);
        assert_eq!(outline(&mask(3, "##. ##.")).collect::<Vec<_>>(), [1, 4]);
    }

    #[test]
    fn one_pixel() {
        let (on, off) = (mask(1, "#"), mask(1, "."));
        assert_eq!(silhouette(&on, &on).unwrap().max_px, 0.0);
        assert_eq!(silhouette(&on, &off).unwrap().max_px, 2.0_f64.sqrt());
    }

    fn masks() -> impl Strategy<Value = (Mask, Mask)> {
        (1_u32..14, 1_u32..14, 0.0..1.0_f64).prop_flat_map(|(w, h, share)| {
            let one = prop::collection::vec(prop::bool::weighted(share), (w * h) as usize)
                .prop_map(move |covered| Mask::new(w, h, covered).unwrap());
            (one.clone(), one)
        })
    }

    proptest! {
        #[test]
        fn distances_agree_with_brute_force((mask, _) in masks()) {
            let (w, h) = (mask.width() as i64, mask.height() as i64);
            let found = squared_distances(&mask);
            for p in 0..w * h {
                let nearest = (0..w * h)
                    .filter(|&q| mask.covered()[q as usize])
                    .map(|q| (p % w - q % w).pow(2) + (p / w - q / w).pow(2))
                    .min()
                    .unwrap_or(w * w + h * h);
                prop_assert_eq!(found[p as usize], nearest as u64, "pixel {}", p);
            }
        }

        #[test]
        fn symmetric_and_zero_only_for_equal_masks((a, b) in masks()) {
            let ab = silhouette(&a, &b).unwrap();
            prop_assert_eq!(ab, silhouette(&b, &a).unwrap());
            prop_assert_eq!(ab.max_px == 0.0, a == b);
            prop_assert!(ab.p95_px <= ab.max_px);
        }
    }
}
