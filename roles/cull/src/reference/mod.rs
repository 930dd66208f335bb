//! The oracle: a rasterizer in f64 that follows Vulkan's rules, and what is built on it. Slow, simple, and
//! independent of the code it checks and of any GPU. Everything here is for tests and for reports; nothing of
//! it runs while walking.

mod attribution;
pub mod cases;
mod cause;
mod fault;
mod grid;
mod nearest;
mod picture;
mod raster;
mod tester;
mod walk;

pub use attribution::{CulledFrame, Missing, causes};
pub use cause::FalseCullCause;
pub use fault::Fault;
pub use nearest::{SURFACE_SLACK_PX, distances_to_surfaces};
pub use picture::{Item, Picture, Placement, rasterize};
pub use raster::{Coverage, rasterize_triangle};
pub use tester::ReferenceTester;
pub use walk::{FalseCull, FrameReport, ReferenceWalk, Testing, WalkError};
