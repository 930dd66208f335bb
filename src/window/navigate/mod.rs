//! A person's position in the scene, and how it moves: the same rules as in the page
//! (`roles/page/src/navigate`).

mod gaze;
mod ground;
mod keys;
mod navigator;
mod prediction;
mod walk;

pub use gaze::Gaze;
pub use ground::{Ground, Solid};
pub use keys::{Keys, Motion};
pub use navigator::{Drag, Mode, Navigator, Start};
pub use prediction::{Pose, Prediction};
pub use walk::Walk;
