//! How wrong a picture is: pure functions over pictures and item images.
//!
//! Two sources of error are kept apart. *Culling error* is the picture against the unculled picture of the same level cut:
//! [`false_culls`], [`mismatching_pixels`]; it must be zero. *Level-of-detail error* is the picture against full detail:
//! [`picture_error`]; it is bounded by epsilon.
//!
//! Pictures are row-major from the top left, 8-bit sRGB red, green, blue, alpha. Alpha is ignored.

mod blob;
mod colour;
mod image;
mod regions;
mod silhouette;
mod visibility;

pub use blob::largest_blob;
pub use colour::{FlipMap, flip, mismatching_pixels, picture_error, psnr_db};
pub use image::{ItemImage, Mask, MetricError, Picture};
pub use regions::{MAX_REGION_SHIFT_PX, region_deviation};
pub use silhouette::{SAMPLING_SLACK_PX, Silhouette, silhouette};
pub use visibility::{FalseCulls, exactly_visible, exactly_visible_triangles, false_culls};
