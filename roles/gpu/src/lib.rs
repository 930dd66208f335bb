//! The Vulkan passes of the three roles. The only crate with `unsafe` graphics code.
//!
//! [`Gpu`] is an open device, [`GpuScene`] a scene on it. Three passes draw lists of drawables:
//! [`OccluderPass`] depth alone, [`PicturePass`] shaded colour, [`ItemPass`] which triangle shows where. All
//! place vertices by the same arithmetic, so that a triangle has the same depth at the same pixels in each.
//! [`QueryTester`] and [`RasterTester`] test boxes against an occluder pass's depth.
//!
//! # Soundness
//! The `unsafe` calls sit in small wrappers (`adapter`, `needs`, `gpu`, `memory`, `in_place`, `stream`,
//! `recorder`, `pipeline`, `query`); the passes above them are safe code. Three rules carry them. An object
//! holds an [`Arc`](std::sync::Arc) of the device it was made from. And whatever owns a stream of
//! commands declares it before the things its commands use: fields drop in order of declaration, and a stream
//! that is dropped waits for the device. Where a stream gives up waiting, nothing of the device is destroyed
//! any more ([`Gpu`]).
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
mod boxes;
mod camera;
mod draw_record;
mod draws;
mod error;
mod gpu;
mod in_place;
mod item;
mod memory;
mod needs;
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
mod wait;

pub use adapter::{DeviceChoice, DeviceKind, GpuInfo};
pub use error::GpuError;
pub use gpu::{Gpu, GpuOptions};
pub use item::{ItemImage, ItemPass};
pub use needs::Optional;
pub use occluder::OccluderPass;
pub use picture::{BACKGROUND, PicturePass};
pub use query::QueryTester;
pub use raster::RasterTester;
pub use scene::GpuScene;
pub use timing::PassTiming;
