//! Camera paths: reading and writing them as JSON, and making seeded walks through a scene ([`auto`]).
//!
//! A walk is a list of frames, each an eye, a forward direction and an up direction in world space
//! (right-handed, metres), and one vertical field of view for all of them.

mod auto;
mod file;
mod flood;
mod frame;
mod gaze;
mod route;
mod space;
#[cfg(test)]
mod testing;
mod triangles;

pub use auto::{AutoWalk, AutoWalkError, AutoWalkOptions, WalkKind, auto};
pub use file::{Walk, WalkError};
pub use frame::{FrameError, WalkFrame};
pub use space::{Hit, Space};
