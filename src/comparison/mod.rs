//! Systems compared with each other: Trimaran with any number of cullers, those of the paper, and one without
//! occlusion culling. They walk through one scene on the same paths at one error bound.

mod figures;
mod page;
mod paths;
#[cfg(test)]
mod sample;
pub mod schema;
mod system;
mod tables;
mod write;

pub use page::ComparedPicture;
pub use paths::{Coherence, PathsError};
pub use system::{Place, System, UnknownSystem};
pub use tables::summary;
pub use write::write;
