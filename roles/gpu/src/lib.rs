//! The Vulkan passes of the three roles. The only crate with `unsafe` graphics code.
//!
//! [`Gpu`] is an open device, [`GpuScene`] a scene on it. Three passes draw lists of drawables:
//! [`OccluderPass`] depth alone, [`PicturePass`] shaded colour, [`ItemPass`] an ID buffer. All place vertices
//! by the same arithmetic, so that a triangle has the same depth at the same pixels in each. [`QueryTest`],
//! [`RasterTest`] and [`DeviceHzbTest`] test boxes against an occluder pass's depth. [`VulkanCuller`] and
//! [`PicturePass`] are the devices of the roles.
//!
//! ```
//! use trimaran_cull::{LodRule, View, Viewport, draw_order, lod_cut};
//! use trimaran_gpu::{BACKGROUND, Gpu, GpuError, GpuOptions, GpuScene, PicturePass};
//! # use glam::DVec3;
//! # use trimaran_audit::cases::{plant, plant_views};
//!
//! let gpu = match Gpu::open(&GpuOptions::default()) {
//!     Err(GpuError::NoLoader(_)) => return Ok(()), // no Vulkan on this machine
//!     gpu => gpu?,
//! };
//! # let size = Viewport::new(64, 48)?;
//! # let scene = plant(1, 500, DVec3::ZERO)?;
//! # let view: View = plant_views(1, 500, DVec3::ZERO, size, 1)?[0];
//! let on_device = GpuScene::new(&gpu, &scene)?;
//! let mut ids = lod_cut(&scene, &view, LodRule::new(2.0)?);
//! draw_order(&scene, &view, &mut ids);
//! let mut pass = PicturePass::new(&on_device, size)?;
//! pass.begin(&view)?;
//! pass.draw(&ids)?;
//! pass.finish()?;
//! let drawn = pass.pixels()?.iter().filter(|pixel| **pixel != BACKGROUND).count();
//! assert!(drawn > 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | `device_id`, `cuda`, `choice` | which device: its number, UUID, PCI address, a job scheduler's grant |
//! | `gpu_info`, `adapter`, `needs`, `gpu`, `wait` | a device: its properties, its requirements, opening it, waiting for it |
//! | `memory`, `reuse`, `arena`, `working_set`, `scene` | buffers, and a scene's data on the device |
//! | `camera`, `sections`, `draw_record`, `draws`, `stream`, `recorder` | shared by the passes |
//! | `layout`, `pipeline`, `scope`, `pass_kind`, `pass`, `solid_pass` | how all of them draw |
//! | `occluder`, `picture`, `item` | the three passes |
//! | `boxes`, `query`, `raster` | tests of boxes that draw them over the occluders' depth |
//! | `pyramid`, `hzb`, `half_depth` | the depth's pyramid, a test of boxes against it, a copy of half of it |
//! | `culler` | the device of a culler: occluders, and one of the tests |
//! | `window` | pictures in windows of the system, with the feature `window` |
//! | `timing`, `timestamps`, `validation` | times of passes, validation messages |
//!
//! # Soundness
//! The `unsafe` calls sit in small wrappers (`adapter`, `needs`, `gpu`, `memory`, `stream`, `recorder`,
//! `pipeline`, `query`, `window`); the passes above them are safe code. Three rules carry them. An object
//! holds an [`Arc`](std::sync::Arc) of the device it was made from. An owner of a stream of commands declares
//! it before the resources of its commands: fields drop in order of declaration, and a stream waits for the
//! device on drop. If a stream gives up waiting, nothing of the device is destroyed any more ([`Gpu`]).
#![allow(
    unsafe_code,
    reason = "Vulkan is called here and nowhere else; each block names the rule that makes it sound"
)]

// The tests within share helpers with those in `tests`, which see the crate from outside.
#[cfg(test)]
extern crate self as trimaran_gpu;
#[cfg(test)]
#[allow(dead_code, reason = "the tests in `tests` use the rest")]
#[allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]
#[path = "../tests/gpu/common.rs"]
mod common;

mod adapter;
mod arena;
mod boxes;
mod camera;
mod choice;
mod cuda;
mod culler;
mod device_id;
mod draw_record;
mod draws;
mod error;
mod gpu;
mod gpu_info;
mod half_depth;
mod hzb;
mod item;
mod layout;
mod memory;
mod needs;
mod occluder;
mod pass;
mod pass_kind;
mod picture;
mod pipeline;
mod place;
mod pyramid;
mod query;
mod raster;
mod recorder;
mod reuse;
mod rounding;
mod scene;
mod scope;
mod sections;
mod solid_pass;
mod stream;
mod timestamps;
mod timing;
mod traversal;
mod traversal_lists;
mod tree;
mod validation;
mod wait;
#[cfg(feature = "window")]
mod window;
mod working_set;

pub use choice::DeviceChoice;
pub use cuda::CudaDevices;
pub use culler::{VulkanCuller, VulkanCullerError};
pub use device_id::{DeviceUuid, NoPciAddress, NoUuid, PciAddress, UuidPrefix};
pub use error::GpuError;
pub use gpu::{Gpu, GpuOptions};
pub use gpu_info::{DeviceKind, GpuInfo, HzbPlace};
pub use hzb::DeviceHzbTest;
pub use item::{ItemImage, ItemPass, Items};
pub use needs::Optional;
pub use occluder::{OccluderPass, Occluders};
pub use picture::{BACKGROUND, PicturePass};
pub use pipeline::SEE_THROUGH_ALPHA;
pub use query::QueryTest;
pub use raster::RasterTest;
pub use scene::GpuScene;
pub use solid_pass::SolidPass;
pub use timing::PassTiming;
#[cfg(feature = "window")]
pub use window::{PresentMode, Presenter, WindowSize};
pub use working_set::WorkingSetStats;
