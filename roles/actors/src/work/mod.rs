//! The roles' work on a frame of a scene, each on its device.

mod costs;
mod culling;
mod gaps;
mod occluders;
mod pictures;
mod pieces;

pub use culling::SceneCulling;
pub use gaps::Gaps;
pub use occluders::{CulledFrame, OccluderPolicy};
pub use pictures::ScenePictures;
