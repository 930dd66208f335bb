//! Small scenes and views for tests: the hard cases of culling, and a random plant to walk through. Tests on
//! a GPU use the same ones as the f64 reference.

mod altered;
mod builder;
mod case;
mod hard;
mod plant;

pub use altered::{with_halved_boxes, with_records};
pub use builder::{Mesh, Object, build};
pub use case::{Case, CaseError, looking, looking_past};
pub use hard::hard_cases;
pub use plant::{PlantCase, plant, plant_in_pieces, plant_views};
