//! Small scenes and views for tests: the hard cases of culling, and a random plant to walk through. GPU
//! testers are tested on the same ones as the oracle.

mod altered;
mod builder;
mod hard;
mod plant;

pub use altered::{with_halved_boxes, with_records};
pub use builder::{Mesh, Object, build};
pub use hard::{Case, CaseError, hard_cases, looking};
pub use plant::{plant, plant_views};
