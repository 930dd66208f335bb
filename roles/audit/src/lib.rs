//! The oracle: a rasterizer in f64 that follows Vulkan's rules, and what is built on it. Slow, simple, and
//! independent of the code it checks and of any GPU. Everything here is for tests and for reports; nothing of
//! it runs while walking.

mod attribution;
pub mod cases;
mod cause;
mod fault;
mod grid;
mod id_buffer;
pub mod metrics;
mod nearest;
mod occlusion_test;
mod raster;
mod walkthrough;

pub use attribution::{CulledFrame, Missing, causes};
pub use cause::FalseCullCause;
pub use fault::Fault;
pub use id_buffer::{Item, Picture, Placement, rasterize};
pub use nearest::{SURFACE_SLACK_PX, distances_to_surfaces};
pub use occlusion_test::ReferenceTester;
pub use raster::{Coverage, rasterize_triangle};
pub use walkthrough::{FalseCull, FrameReport, ReferenceWalk, Testing, WalkError};
