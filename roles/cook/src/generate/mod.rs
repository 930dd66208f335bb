//! Generators of models for machines that have no data: a process plant and a tanker, of any size.
//!
//! Both are made of the same catalogue of parts and of rooms with walls and doors, so that from inside most
//! of the model is hidden. A seed gives the same model on every platform and in every release of the same
//! major version: all branching is on integers and on the four exactly rounded operations and square roots,
//! sines come from one portable implementation.
//!
//! Frames: y up, metres; each storey's floor is at a multiple of the storey's height.

mod assembly;
mod brush;
mod equipment;
mod paint;
mod plant;
mod room;
mod shape;
mod tanker;

pub use plant::{PlantOptions, plant};
pub use tanker::{TankerOptions, tanker};
