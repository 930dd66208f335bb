//! Systems compared with each other: Trimaran with any number of cullers, those of the paper, and one without
//! occlusion culling. They walk through one scene on one path at one error bound.

mod paths;
mod system;

pub use paths::{Coherence, PathsError};
pub use system::{Place, System, UnknownSystem};
