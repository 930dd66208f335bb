//! Shared by tests: the program and its peers as processes, a browser, a screen, real data, a device, and a
//! way to report a skipped test.
#![allow(dead_code, reason = "each executable uses its part of this")]

pub(crate) mod cubes;
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

use std::{
    env,
    fmt::Display,
    sync::{Arc, LazyLock},
};

use trimaran_gpu::{Gpu, GpuError, GpuOptions};

/// The most devices that a test has.
const DEVICES: usize = 4;

/// The best device, validated, opened this many times. `None`, which skips the test, if there is no device
/// and `TRIMARAN_REQUIRE_GPU` is not set.
///
/// All tests of a process share them, and they are never closed: Debian's validation layer crashes a thread
/// that calls Vulkan while another opens or closes a device (Vulkan-ValidationLayers, issue 4391).
pub(crate) fn devices() -> Option<&'static [Arc<Gpu>; DEVICES]> {
    static OPENED: LazyLock<Result<[Arc<Gpu>; DEVICES], GpuError>> = LazyLock::new(|| {
        let open = || Gpu::open(&GpuOptions { validation: true, ..GpuOptions::default() });
        Ok([open()?, open()?, open()?, open()?])
    });
    unless_required(OPENED.as_ref())
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
