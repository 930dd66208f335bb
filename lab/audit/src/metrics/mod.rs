//! Measures of image errors: pure functions over colour images and ID buffers.
//!
//! Two sources of error are kept apart. *Culling error* is the image against that of the same LOD cut without
//! culling: [`false_culls`], [`mismatching_pixels`]; it must be zero. *Level-of-detail error* is the image
//! against full detail: [`image_difference`] by colour, and [`Deviation`] by distance, which epsilon bounds.
//!
//! Images are row-major from the top left, 8-bit sRGB red, green, blue, alpha. Alpha is ignored.

mod blob;
mod colour;
mod deviation;
mod image;
mod visibility;

pub use blob::largest_blob;
pub use colour::{FlipMap, flip, image_difference, mismatching_pixels, psnr_db};
pub use deviation::{Deviation, silhouette};
pub use image::{IdBufferRef, ImageRef, Mask, MetricError};
pub use visibility::{FalseCulls, exactly_visible, exactly_visible_triangles, false_culls};
