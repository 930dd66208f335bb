//! Camera paths: reading and writing them as JSON.
//!
//! A walk is a list of frames, each an eye, a forward direction and an up direction in world space (right-handed, metres),
//! and one vertical field of view for all of them.

mod file;
mod frame;

pub use file::{Walk, WalkError};
pub use frame::{FrameError, WalkFrame};
