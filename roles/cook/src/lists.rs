//! Items of lists by numbers that may lead nowhere.

/// The item at a place, or the default.
pub(crate) fn at<T: Copy + Default>(list: &[T], place: impl TryInto<usize>) -> T {
    place.try_into().ok().and_then(|place| list.get(place)).copied().unwrap_or_default()
}

/// Replaces the item at a place, if there is one.
pub(crate) fn put<T>(list: &mut [T], place: impl TryInto<usize>, item: T) {
    if let Some(slot) = place.try_into().ok().and_then(|place| list.get_mut(place)) {
        *slot = item;
    }
}
