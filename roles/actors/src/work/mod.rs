//! What roles do with a frame of a scene, each on its device.

mod culling;
mod gaps;
mod occluders;
mod pictures;

pub use culling::SceneCulling;
pub use gaps::Gaps;
pub use occluders::{CulledFrame, OccluderPolicy};
pub use pictures::ScenePictures;
