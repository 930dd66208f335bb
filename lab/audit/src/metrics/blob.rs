//! The largest connected blob of pixels: one hole of 400 pixels is worse than 400 single pixels.

use super::Mask;

/// The size in pixels of the largest 8-connected blob of covered pixels; 0 if none is covered.
#[must_use]
pub fn largest_blob(mask: &Mask) -> u64 {
    let (width, height) = (mask.width(), mask.height());
    let mut open = mask.covered().to_vec();
    let mut stack = Vec::new();
    let mut largest = 0;
    for seed in 0..open.len() {
        let mut size = 0;
        take(&mut open, seed, &mut stack);
        while let Some(pixel) = stack.pop() {
            size += 1;
            let (x, y) = (pixel % width, pixel / width);
            for near_y in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                for near_x in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                    take(&mut open, near_y * width + near_x, &mut stack);
                }
            }
        }
        largest = largest.max(size);
    }
    largest
}

/// Moves a pixel that is still open onto the stack.
fn take(open: &mut [bool], pixel: usize, stack: &mut Vec<usize>) {
    if std::mem::take(&mut open[pixel]) {
        stack.push(pixel);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::image::mask;
    use super::*;

    #[test]
    fn diagonal_neighbours_connect_and_row_ends_do_not() {
        assert_eq!(largest_blob(&mask(4, "#... .#.. ..#. ....")), 3);
        assert_eq!(largest_blob(&mask(3, "..# #.. ...")), 1);
        assert_eq!(largest_blob(&mask(1, ".")), 0);
        assert_eq!(largest_blob(&mask(3, "### ### ###")), 9);
    }

    proptest! {
        /// Against labels that spread until nothing changes.
        #[test]
        fn agrees_with_label_propagation(
            (width, covered) in (1_usize..9, 1_usize..9)
                .prop_flat_map(|(w, h)| (Just(w), prop::collection::vec(any::<bool>(), w * h)))
        ) {
            let height = covered.len() / width;
            let mut labels: Vec<usize> = (0..covered.len()).collect();
            loop {
                let before = labels.clone();
                for a in 0..covered.len() {
                    for b in 0..covered.len() {
                        let near = (a % width).abs_diff(b % width) <= 1 && (a / width).abs_diff(b / width) <= 1;
                        if covered[a] && covered[b] && near {
                            labels[a] = labels[a].min(labels[b]);
                        }
                    }
                }
                if labels == before {
                    break;
                }
            }
            let size = |label| (0..covered.len()).filter(|&p| covered[p] && labels[p] == label).count();
            let largest = (0..covered.len()).map(size).max().unwrap_or(0);
            let mask = Mask::new(width as u32, height as u32, covered.clone()).unwrap();
            prop_assert_eq!(largest_blob(&mask), largest as u64);
        }
    }
}
