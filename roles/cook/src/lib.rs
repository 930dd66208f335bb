//! Makes cooked scenes of CAD files: importers and generators make a [`Model`], [`cook`] makes a [`Scene`] of
//! it, with levels of detail whose error is certified.
//!
//! A program that only opens scenes needs `trimaran-scene` instead.
//!
//! ```
//! use trimaran_cook::generate::{PlantOptions, plant};
//! use trimaran_cook::{CookOptions, cook};
//!
//! let model = plant(&PlantOptions::small(7));
//! let scene = cook(&model, &CookOptions::default(), &())?;
//! assert!(scene.drawables().len() >= model.objects.len());
//! # Ok::<(), trimaran_cook::CookError>(())
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | [`import`](mod@import) | glTF 2.0, AVEVA review files, Wavefront OBJ, STL, PLY; STEP, IGES and IFC by converters |
//! | [`generate`] | a process plant and a tanker of any size |
//! | `model` | what both make: meshes, and objects that place them |
//! | `cook` | the tree, levels of detail and their certificates |
//!
//! [`Scene`]: trimaran_scene::Scene

mod cook;
pub mod generate;
pub mod import;
mod lists;
mod model;

pub use cook::{CookError, CookOptions, Phase, Progress, cook, hausdorff_bound};
pub use model::{Mesh, Model, ModelError, Object, Source};
pub use trimaran_scene::Rgba8;
