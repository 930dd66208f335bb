//! Exactly visible sets from ID buffers, and the losses by culling.

use std::collections::BTreeMap;

use super::image::same_size;
use super::{IdBufferRef, Mask, MetricError, largest_blob};

/// The losses by culling.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FalseCulls {
    /// Each id that owns pixels of the unculled image and was not drawn, with the pixels it owns; ascending.
    pub nodes: Vec<(u32, u64)>,
    /// The pixels that those ids own.
    pub pixels: u64,
    /// The largest 8-connected blob of those pixels.
    pub largest_blob: u64,
    /// Pixels with another owner in the culled image, although the unculled owner was drawn: wrong without a
    /// false cull, as when two passes compute different positions.
    pub other_owner_pixels: u64,
}

/// The ids that own a pixel, ascending, each once: the exactly visible set.
#[must_use]
pub fn exactly_visible(image: &IdBufferRef<'_>) -> Vec<u32> {
    sorted_distinct(image.owners().flatten().collect())
}

/// The number of triangles that own a pixel. `primitives` holds each pixel's triangle within its owner;
/// `None` if it is of another size than the image.
#[must_use]
pub fn exactly_visible_triangles(image: &IdBufferRef<'_>, primitives: &[u32]) -> Option<u64> {
    let owners = image.owners();
    if owners.len() != primitives.len() {
        return None;
    }
    let pairs = owners.zip(primitives).filter_map(|(owner, &triangle)| Some((owner?, triangle))).collect();
    Some(sorted_distinct(pairs).len() as u64)
}

/// The losses by culling: `unculled` and `culled` are the ID buffers of the same LOD cut, `drawn` the drawn
/// ids, in any order.
///
/// # Errors
/// If the images differ in size.
pub fn false_culls(
    unculled: &IdBufferRef<'_>,
    culled: &IdBufferRef<'_>,
    drawn: &[u32],
) -> Result<FalseCulls, MetricError> {
    same_size(unculled.size(), culled.size())?;
    let drawn = sorted_distinct(drawn.to_vec());
    let was_drawn = |id: u32| drawn.binary_search(&id).is_ok();

    let mut nodes = BTreeMap::new();
    let mut lost = Vec::with_capacity(unculled.owners().len());
    let mut other_owner_pixels = 0;
    // Neighbouring pixels mostly share their owner: one look-up per run of equal owners.
    let mut run = (None, true);
    for (owner, shown) in unculled.owners().zip(culled.owners()) {
        if run.0 != owner {
            run = (owner, owner.is_none_or(was_drawn));
        }
        lost.push(!run.1);
        match owner {
            Some(id) if !run.1 => *nodes.entry(id).or_insert(0) += 1,
            _ => other_owner_pixels += u64::from(owner != shown),
        }
    }
    let pixels = nodes.values().sum();
    let (width, height) = unculled.size();
    let largest_blob = if pixels == 0 { 0 } else { largest_blob(&Mask::new(width, height, lost)?) };
    Ok(FalseCulls { nodes: nodes.into_iter().collect(), pixels, largest_blob, other_owner_pixels })
}

fn sorted_distinct<T: Ord>(mut values: Vec<T>) -> Vec<T> {
    values.dedup();
    values.sort_unstable();
    values.dedup();
    values
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const NONE: u32 = u32::MAX;

    fn image(width: u32, ids: &[u32]) -> IdBufferRef<'_> {
        IdBufferRef::new(width, ids.len() as u32 / width, ids, NONE).unwrap()
    }

    #[test]
    fn a_missing_node_is_counted_with_its_pixels_and_its_blob() {
        let unculled = [1, 1, 2, NONE, 2, 3, 2, 3, 3];
        let culled = [1, 1, NONE, NONE, 3, 3, NONE, 3, 3];
        let lost = false_culls(&image(3, &unculled), &image(3, &culled), &[3, 1]).unwrap();
        assert_eq!(lost.nodes, [(2, 3)]);
        assert_eq!(lost.pixels, 3);
        assert_eq!(lost.largest_blob, 3, "a diagonal is connected");
        assert_eq!(lost.other_owner_pixels, 0);
    }

    #[test]
    fn a_drawn_node_that_lost_its_pixel_is_no_false_cull() {
        let lost = false_culls(&image(2, &[1, 2]), &image(2, &[1, 1]), &[1, 2]).unwrap();
        assert_eq!(lost, FalseCulls { other_owner_pixels: 1, ..FalseCulls::default() });
    }

    #[test]
    fn nothing_visible_and_nothing_drawn_is_no_error() {
        let empty = image(2, &[NONE; 4]);
        assert_eq!(false_culls(&empty, &empty, &[]), Ok(FalseCulls::default()));
        assert!(exactly_visible(&empty).is_empty());
    }

    #[test]
    fn images_of_different_sizes_are_refused() {
        let error = false_culls(&image(2, &[1, 2]), &image(1, &[1, 2]), &[]).unwrap_err();
        assert_eq!(error, MetricError::Differ { left: (2, 1), right: (1, 2) });
    }

    #[test]
    fn triangles_are_counted_within_their_owner() {
        let ids = image(3, &[1, 1, 2, 2, NONE, NONE]);
        assert_eq!(exactly_visible_triangles(&ids, &[0, 0, 0, 1, 7, 8]), Some(3));
        assert_eq!(exactly_visible_triangles(&ids, &[0]), None);
    }

    proptest! {
        #[test]
        fn agrees_with_sets(
            ids in prop::collection::vec(prop_oneof![0_u32..6, Just(NONE)], 1..40),
            drawn in prop::collection::vec(0_u32..6, 0..8),
        ) {
            let unculled = image(1, &ids);
            let visible: std::collections::BTreeSet<u32> = ids.iter().copied().filter(|&i| i != NONE).collect();
            prop_assert_eq!(exactly_visible(&unculled), visible.iter().copied().collect::<Vec<_>>());
            let lost = false_culls(&unculled, &unculled, &drawn).unwrap();
            let expected: Vec<(u32, u64)> = visible
                .into_iter()
                .filter(|id| !drawn.contains(id))
                .map(|id| (id, ids.iter().filter(|&&i| i == id).count() as u64))
                .collect();
            prop_assert_eq!(lost.pixels, expected.iter().map(|(_, pixels)| pixels).sum::<u64>());
            prop_assert_eq!(lost.nodes, expected);
        }
    }
}
