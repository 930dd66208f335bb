//! How wrong a picture is: pure functions over pictures and item images.
//!
//! Two sources of error are kept apart. *Culling error* is the picture against the unculled picture of the
//! same level cut: [`false_culls`], [`mismatching_pixels`]; it must be zero. *Level-of-detail error* is the
//! picture against full detail: [`image_difference`] by colour, and [`Deviation`] by distance, which epsilon
//! bounds.
//!
//! Pictures are row-major from the top left, 8-bit sRGB red, green, blue, alpha. Alpha is ignored.

mod blob;
mod colour;
mod deviation;
mod image;
mod visibility;

pub use blob::largest_blob;
pub use colour::{FlipMap, ImageDifference, flip, image_difference, mismatching_pixels, psnr_db};
pub use deviation::{Deviation, silhouette};
pub use image::{ItemImage, Mask, MetricError, Picture};
pub use visibility::{FalseCulls, exactly_visible, exactly_visible_triangles, false_culls};
