//! Systems held against each other: Trimaran with any number of cullers, those of the paper, and what has no
//! occlusion culling at all. They walk through one scene on one path at one error bound.

mod paths;
mod system;

pub use paths::{Coherence, PathsError};
pub use system::{Place, System, UnknownSystem};
