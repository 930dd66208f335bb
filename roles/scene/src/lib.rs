//! The cooked scene: opening and checking its file, its tree and levels of detail, and walks through it.
//!
//! This is what a role needs. What makes a scene of CAD files is in `trimaran-cook`.
//!
//! | module | what is in it |
//! |---|---|
//! | `scene` | [`Scene`]: the file, its records, and the checks that later code relies on |
//! | [`walk`] | walks: made for a scene by a seed, or read from a file |
//! | [`random`] | random numbers that are the same everywhere |

pub mod random;
mod scene;
pub mod walk;

pub use scene::{
    Drawable, Node, NodeId, Normal, ObjectRecord, OpenError, Rgba8, SaveError, Scene, SceneArrays,
    SceneError, Shading, Vertex,
};
