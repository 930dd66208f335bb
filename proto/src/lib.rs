//! The wire of Trimaran: what the three roles say to each other, byte for byte.
//!
//! Sans-IO: nothing here touches a socket, a clock or a GPU. `WIRE.md` beside this crate specifies every byte.

mod camera;
mod id;

pub use camera::{Camera, CameraError};
pub use id::{DrawableId, FrameNumber, SceneHash};
