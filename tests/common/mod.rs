//! Shared by tests: the program and its peers as processes, a browser, a screen, real data, a device, and a
//! way to report a skipped test.
#![allow(dead_code, reason = "each executable uses its part of this")]

pub(crate) mod data;
pub(crate) mod deployment;
pub(crate) mod guests;
pub(crate) mod house;
pub(crate) mod page;
#[path = "../../transport/tests/common/ports.rs"]
pub(crate) mod ports;
pub(crate) mod program;
pub(crate) mod scenes;
#[cfg(target_os = "linux")]
pub(crate) mod screen;
pub(crate) mod session;

use std::{env, fmt::Display, sync::Arc};

use trimaran_gpu::{Gpu, GpuOptions};

/// The best device, with validation if its layer is installed. `None`, which skips the test, if there is no
/// device and `TRIMARAN_REQUIRE_GPU` is not set.
pub(crate) fn device() -> Option<Arc<Gpu>> {
    unless_required(Gpu::open(&options()))
}

/// The options with which tests open devices.
pub(crate) fn options() -> GpuOptions {
    GpuOptions { validation: true, ..GpuOptions::default() }
}

/// The opened device, or `None` if that failed and none is required.
pub(crate) fn unless_required<T, E: Display>(opened: Result<T, E>) -> Option<T> {
    match opened {
        Ok(opened) => Some(opened),
        Err(error) if env::var_os("TRIMARAN_REQUIRE_GPU").is_none() => {
            println!("skipped: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}
