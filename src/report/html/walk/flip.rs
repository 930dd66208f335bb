//! Maps of the FLIP error of a picture.

use maud::Markup;
use trimaran_audit::metrics::{ImageRef, flip};
use trimaran_cull::{Image, RgbImage};

use super::comparison::{Shrink, pane};

/// The FLIP map of a picture as a pane; nothing if it cannot be made.
pub(crate) fn flip_pane(reference: &Image, picture: &Image, text: &str) -> Markup {
    let map =
        |[reference, picture]: [&Image; 2]| flip_map(&RgbImage::of(reference)?, &RgbImage::of(picture)?);
    let map = map([reference, picture]);
    map.map_or_else(Markup::default, |map| pane("FLIP", text, &map, Shrink::Brightest))
}

/// The FLIP map in the "magma" colours that its authors use; `None` if the sizes differ.
pub(super) fn flip_map(reference: &RgbImage, picture: &RgbImage) -> Option<RgbImage> {
    let rgba = |image: &RgbImage| -> Vec<u8> {
        image.pixels.iter().flat_map(|[r, g, b]| [*r, *g, *b, 255]).collect()
    };
    let (reference_rgba, picture_rgba) = (rgba(reference), rgba(picture));
    let map = flip(
        &ImageRef::new(reference.width, reference.height, &reference_rgba).ok()?,
        &ImageRef::new(picture.width, picture.height, &picture_rgba).ok()?,
    )
    .ok()?;
    let colours = nv_flip::magma_lut().to_vec();
    let (colours, _) = colours.as_chunks::<3>();
    let colour = |value: &f32| {
        let index = (value.clamp(0.0, 1.0) * 255.0).round() as usize;
        colours.get(index).copied().unwrap_or_default()
    };
    let pixels = map.values().iter().map(colour).collect();
    Some(RgbImage { width: reference.width, height: reference.height, pixels })
}
