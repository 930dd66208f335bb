//! From CAD files to a cooked scene: importers, the spatial tree, levels of detail with a certified error, generators, and
//! the file that the roles share.

pub mod cook;
pub mod generate;
pub mod import;
pub mod walk;

mod model;
mod scene;

pub use model::{Mesh, Model, ModelError, Object, Rgba8, Source};
pub use scene::{
    Drawable, Node, NodeId, Normal, ObjectRecord, OpenError, SaveError, Scene, SceneArrays, SceneError,
    Shading, Vertex,
};
