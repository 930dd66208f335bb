//! What the tests of whole walkthroughs share: real data, a device, sessions, and a way to say that a test
//! was skipped.
#![allow(dead_code, reason = "each test file uses its part of this")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

pub(crate) mod data;
pub(crate) mod session;

use std::{env, fmt::Display, sync::Arc};

use trimaran_gpu::{Gpu, GpuOptions};

/// The best device, with validation where its layer is installed; `None`, which skips the test, where there
/// is none and `TRIMARAN_REQUIRE_GPU` is not set.
pub(crate) fn device() -> Option<Arc<Gpu>> {
    unless_required(Gpu::open(&options()))
}

/// How tests open devices.
pub(crate) fn options() -> GpuOptions {
    GpuOptions { validation: true, ..GpuOptions::default() }
}

/// What a device gave, or `None` if it failed and none is required.
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
