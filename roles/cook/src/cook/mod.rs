//! Cooking: makes a scene of a model.
//!
//! 1. Each distinct mesh gets a chain of levels of detail (`levels`). All objects that place the mesh share
//!    them. The finest level of a large mesh is cut into clusters (`clusters`) that are culled one by one,
//!    and a large mesh into parts (`large_mesh`) with levels of their own.
//! 2. A spatial tree is built over the objects (`tree`), each a leaf.
//! 3. From the leaves up, each interior node gets up to two levels merged from levels below it (`hlod`,
//!    `thin`).
//! 4. All of it is laid out as the arrays of a [`Scene`] (`assemble`), and solids are marked
//!    (`solid`).
//!
//! Each level's error is certified: an upper bound of the two-sided Hausdorff distance to the finest geometry
//! (`hausdorff`, `thin`), never the simplifier's own estimate, which is up to seven times too small where
//! whole parts vanish. The same model and options make the same bytes, on any number of threads.

mod assemble;
mod bvh;
mod chain;
mod clusters;
mod facets;
mod gather;
mod hausdorff;
mod hlod;
mod large_mesh;
mod levels;
mod linear;
mod opening;
mod placed;
mod polygon;
mod see_through;
mod sets;
mod solid;
mod submesh;
mod thin;
mod tree;

use thiserror::Error;

use crate::{Model, ModelError};
use trimaran_scene::{Scene, SceneArrays, SceneError};

pub use hausdorff::hausdorff_bound;

/// The options of cooking.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CookOptions {
    /// The most triangles of a merged level of an interior node; most have fewer.
    pub merged_triangles: usize,
    /// The most nodes of the scene. Each object is one, and a large mesh some per hundred triangles, in each
    /// of its instances: a few numbers in a file may ask for more nodes than fit into memory. A node takes
    /// about 200 bytes.
    pub max_nodes: usize,
}

impl Default for CookOptions {
    fn default() -> Self {
        Self { merged_triangles: 1024, max_nodes: 100_000_000 }
    }
}

/// The stages of cooking, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Phase {
    /// Simplifying each distinct mesh; a step is a mesh.
    Levels,
    /// Building the tree; one step.
    Tree,
    /// Merging levels for interior nodes; a step is a node.
    Merging,
    /// Laying out and checking the scene; one step.
    Assembling,
}

/// Receives the progress of cooking, from any thread. `()` ignores it.
pub trait Progress: Sync {
    /// A stage of `steps` steps begins; the one before it has ended.
    fn begin(&self, phase: Phase, steps: usize);
    /// This many more steps of the stage are done.
    fn advance(&self, steps: usize);
}

impl Progress for () {
    fn begin(&self, _: Phase, _: usize) {}
    fn advance(&self, _: usize) {}
}

/// Why a model cannot be cooked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CookError {
    /// The model breaks a rule.
    #[error("the model cannot be cooked")]
    Model(#[from] ModelError),
    /// No object has a triangle.
    #[error("the model has nothing to draw: {objects} objects, none with a triangle of its own extent")]
    Empty {
        /// The number of objects.
        objects: usize,
    },
    /// Single precision cannot hold a placement.
    #[error("object {object} ({name:?}) is too large or too far away: its placement overflows")]
    Placement {
        /// Index of the object.
        object: usize,
        /// Its name.
        name: String,
    },
    /// The scene would have too many nodes.
    #[error(
        "the scene would have {nodes} nodes, {limit} are allowed; most are of objects like {object} ({name:?}), with {own} \
         each; if the model is as large as that, allow more with --max-nodes, or import it as several scenes"
    )]
    TooManyNodes {
        /// The approximate number of nodes.
        nodes: usize,
        /// The limit.
        limit: usize,
        /// An object of the mesh with the most nodes over all its objects.
        object: usize,
        /// Its name.
        name: String,
        /// How many nodes it takes.
        own: usize,
    },
    /// The scene is invalid: too many records, in practice.
    #[error("the cooked scene would be malformed")]
    Scene(#[from] SceneError),
}

/// Cooks a model. The scene's objects are the model's, in order; those without triangles have no leaf.
///
/// # Errors
/// If the model breaks a rule of [`Model::check`], has nothing to draw, or outgrows the format.
pub fn cook(model: &Model, options: &CookOptions, progress: &dyn Progress) -> Result<Scene, CookError> {
    let arrays = arrays(model, options, progress)?;
    let scene = Scene::from_arrays(arrays)?.with_overview();
    progress.advance(1);
    Ok(scene)
}

/// The arrays of its scene. All else that cooking needs memory for is dropped.
fn arrays(model: &Model, options: &CookOptions, progress: &dyn Progress) -> Result<SceneArrays, CookError> {
    model.check()?;
    let meshes = levels::simplify_meshes(model, progress);
    let leaves = placed::place_objects(model, &meshes)?;
    if leaves.is_empty() {
        return Err(CookError::Empty { objects: model.objects.len() });
    }
    placed::check_nodes(model, &meshes, &leaves, options.max_nodes)?;
    progress.begin(Phase::Tree, 1);
    let boxes: Vec<_> = leaves.iter().map(|leaf| leaf.world).collect();
    let tree = tree::build(&boxes);
    progress.advance(1);
    let merged = hlod::merge_all(&tree, &leaves, &meshes, options, progress);
    progress.begin(Phase::Assembling, 1);
    assemble::assemble(model, meshes, &leaves, &tree, merged)
}
