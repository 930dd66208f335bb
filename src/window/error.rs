//! Why a window could not be opened, or was closed.

use std::io;

use thiserror::Error;
use trimaran_actors::SessionError;
use trimaran_gpu::GpuError;
use trimaran_proto::{CameraError, SettingsError};
use winit::error::{EventLoopError, OsError};

use super::service::AskError;

/// Why a window could not be opened, or was closed by an error.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WindowError {
    /// There is no screen.
    #[error(
        "there is no screen to open a window on; set DISPLAY or WAYLAND_DISPLAY, or walk in a browser \
         (leave --window out)"
    )]
    NoScreen(#[source] EventLoopError),
    /// The system cannot open a window.
    #[error("the system does not open a window")]
    Window(#[source] OsError),
    /// The device failed, or cannot present to the window.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The window is larger than the largest picture.
    #[error("the window is larger than any picture")]
    Size(#[source] SettingsError),
    /// The eye is at an invalid position for a camera.
    #[error("no picture can be drawn from there")]
    Eye(#[source] CameraError),
    /// The service gave no valid answer.
    #[error("the service cannot be asked")]
    Service(#[source] AskError),
    /// The system gives no thread.
    #[error("the system gives no thread")]
    Thread(#[source] io::Error),
    /// Culling has failed.
    #[error("what is visible cannot be found out any more")]
    Session(#[source] SessionError),
}

impl WindowError {
    /// Whether the machine is the cause, and other flags may help.
    #[must_use]
    pub const fn is_of_input(&self) -> bool {
        matches!(self, Self::NoScreen(_) | Self::Gpu(GpuError::NoPresentMode { .. } | GpuError::NoWindows))
    }
}
