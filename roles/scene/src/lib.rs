//! The cooked scene: opening and checking its file, its tree and levels of detail, and camera paths.
//!
//! Roles need only this crate. `trimaran-cook` makes scenes of CAD files.
//!
//! ```
//! # use trimaran_cook::{CookOptions, cook, generate::{PlantOptions, plant}};
//! use trimaran_scene::Scene;
//!
//! # let folder = std::env::temp_dir().join(format!("trimaran-scene-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! # let path = folder.join("plant.scene");
//! # cook(&plant(&PlantOptions::small(7)), &CookOptions::default(), &())?.save(&path)?;
//! let scene = Scene::open(&path)?;
//! let root = &scene.nodes()[0];
//! let leaves = scene.nodes().iter().filter(|node| node.is_leaf());
//! let finest = leaves.filter_map(|leaf| scene.levels(leaf).next());
//! println!("{} objects in {:?}, {} leaves", scene.objects().len(), root.world_box(), finest.count());
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | `scene` | [`Scene`]: the file, its records loaded on demand, and their checks |
//! | [`clearance`] | distances between objects, and clashes |
//! | [`heightfield`] | the solid parts, for walking |
//! | `overview` | finding the [`Overview`] of a scene |
//! | [`path`] | camera paths: made for a scene by a seed, or read from a file |
//! | [`random`] | random numbers that are the same everywhere |

pub mod clearance;
pub mod heightfield;
mod overview;
pub mod path;
pub mod random;
mod scene;

pub use scene::{
    Attribute, Bounds, Coordinates, Drawable, DrawableEntry, EntriesError, Extent, FORMAT_VERSION,
    FORMAT_VERSIONS, FileFrame, FlatObject, Geometry, GeometryError, GeometryPlace, GeometryReader,
    GiveError, Group, GroupLevel, GroupLevelError, Hierarchy, Level, Levels, MOST_ENTRIES, Node, NodeId,
    Normal, ObjectAttributes, ObjectRecord, OpenError, Overview, PlantFrame, ReadCause, ReadError, Records,
    Rgba8, SaveError, Scene, SceneArrays, SceneError, Shading, Sides, Totals, UpAxis, Vertex,
    looks_like_a_scene, pack_entries, unpack_entries,
};
