//! Resources that are kept from one batch or frame to the next.

use crate::GpuError;

/// The kept resource if it fits, else one that `make` makes in its place.
pub(crate) fn reuse_or_make<T>(
    kept: &mut Option<T>,
    fits: impl FnOnce(&T) -> bool,
    make: impl FnOnce() -> Result<T, GpuError>,
) -> Result<&mut T, GpuError> {
    let fitting = kept.take().filter(fits).map_or_else(make, Ok)?;
    Ok(kept.insert(fitting))
}
