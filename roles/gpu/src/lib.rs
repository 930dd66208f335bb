//! The Vulkan passes of the three roles. The only crate with `unsafe` graphics code.
//!
//! [`Gpu`] is an open device, [`GpuScene`] a scene on it. Three passes draw lists of drawables: [`OccluderPass`] depth alone,
//! [`PicturePass`] shaded colour, [`ItemPass`] which triangle shows where. All place vertices by the same arithmetic, so that a
//! triangle has the same depth at the same pixels in each. [`QueryTester`] and [`RasterTester`] test boxes against an occluder pass's
//! depth.
//!
//! # Soundness
//! The `unsafe` calls sit in small wrappers (`gpu`, `memory`, `in_place`, `stream`, `recorder`, `pipeline`, `query`); the passes above them are safe code.
//! Two rules carry them. An object holds an [`Arc`](std::sync::Arc) of the device it was made from. And whatever owns a stream of
//! commands declares it before the things its commands use: fields drop in order of declaration, and a stream that is dropped waits
//! for the device.
#![allow(
    unsafe_code,
    reason = "Vulkan is called here and nowhere else; each block names the rule that makes it sound"
)]

mod adapter;
mod boxes;
mod camera;
mod draws;
mod error;
mod gpu;
mod in_place;
mod item;
mod memory;
mod occluder;
mod pass;
mod picture;
mod pipeline;
mod query;
mod raster;
mod recorder;
mod scene;
mod stream;
mod timing;
mod validation;

pub use adapter::{DeviceChoice, DeviceKind, GpuInfo};
pub use error::GpuError;
pub use gpu::{Gpu, GpuOptions};
pub use item::{ItemImage, ItemPass};
pub use occluder::OccluderPass;
pub use picture::{BACKGROUND, Picture, PicturePass};
pub use query::QueryTester;
pub use raster::RasterTester;
pub use scene::GpuScene;
pub use timing::PassTiming;
