//! Camera paths: reading and writing them as JSON, and making seeded walks through a scene ([`auto`]).
//!
//! A path is a list of poses, each an eye, a forward direction and an up direction in world space
//! (right-handed, metres), and one vertical field of view for all of them.

mod auto;
mod file;
mod flood;
mod gaze;
mod pose;
mod route;
mod space;
#[cfg(test)]
pub(crate) mod testing;
mod triangles;

pub use auto::{AutoPath, AutoPathError, AutoPathOptions, PathKind, auto};
pub use file::{PathError, PosePath};
pub use pose::{Pose, PoseError};
pub use space::{Hit, Space};
