//! Errors between this process and a graphics device.

use std::time::Duration;

use ash::vk;
use gpu_allocator::AllocationError;
use thiserror::Error;
use trimaran_cull::Viewport;
use trimaran_proto::DrawableId;
use trimaran_scene::ReadError;

/// Why a graphics operation failed. Each message names the operation and, if there is one, the remedy.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GpuError {
    /// The Vulkan loader library is not installed.
    #[error("no Vulkan loader on this machine; install it (Debian and Ubuntu: apt install libvulkan1)")]
    NoLoader(#[source] ash::LoadingError),
    /// There is a loader, but no driver offers a device.
    #[error(
        "no Vulkan device on this machine; install a driver (Debian and Ubuntu: apt install mesa-vulkan-drivers, \
         which also brings one for the CPU alone)"
    )]
    NoDevice,
    /// Validation was requested and its layer is not installed.
    #[error(
        "the Vulkan validation layer is not installed; install it (Debian and Ubuntu: apt install \
         vulkan-validationlayers) or open the device without validation"
    )]
    NoValidationLayer,
    /// Vulkan does not support windows of this kind here.
    #[error(
        "Vulkan cannot show windows of this display: its loader or driver lacks the extension; \
         walk in the browser instead (leave --window out)"
    )]
    NoWindows,
    /// The device draws, but cannot show pictures in this window.
    #[error("the Vulkan device {device} cannot show pictures in this window: {lack}; try another (--device)")]
    CannotPresent {
        /// The device's name.
        device: String,
        /// The missing feature.
        lack: &'static str,
    },
    /// The window's driver lacks the requested present mode.
    #[error("this window has no present mode {wanted}: it has {found}")]
    NoPresentMode {
        /// The requested name.
        wanted: &'static str,
        /// The available names.
        found: String,
    },
    /// No device has the requested name, number, UUID or PCI address.
    #[error("no Vulkan device matches {wanted:?}; this machine has: {found}")]
    NoSuchDevice {
        /// The request.
        wanted: String,
        /// The numbers and names of the available devices.
        found: String,
    },
    /// Devices match, but each lacks a required feature.
    #[error("the Vulkan device {device} lacks {missing}; a newer driver may have it")]
    Unsuitable {
        /// The name of the best device that matched.
        device: String,
        /// The missing features, by Vulkan's own names.
        missing: String,
    },
    /// The device was lost: the driver crashed, was reset, or was taken away. Open it anew.
    #[error("the graphics device was lost while {operation}; open it again")]
    DeviceLost {
        /// The operation.
        operation: &'static str,
    },
    /// The device has made no progress for the timeout of [`GpuOptions`](crate::GpuOptions). It does nothing
    /// more for this process.
    #[error(
        "the graphics device hangs: no progress within {timeout:?} while {operation}; look at the driver's \
         messages (dmesg), start again, or wait longer if the device is only slow (--device-timeout)"
    )]
    DeviceHung {
        /// The operation.
        operation: &'static str,
        /// The time without progress.
        timeout: Duration,
    },
    /// The pass's owner has cancelled the wait. The pass is unusable then; another one on the same device
    /// works.
    #[error("asked to stop while {operation}")]
    Cancelled {
        /// The operation.
        operation: &'static str,
    },
    /// Host or device memory ran out.
    #[error("out of memory while {operation}")]
    OutOfMemory {
        /// The operation.
        operation: &'static str,
    },
    /// Memory for one buffer or image could not be allocated.
    #[error("no memory on the graphics device for {what} ({bytes} bytes)")]
    Allocation {
        /// The purpose of the memory.
        what: &'static str,
        /// The requested bytes.
        bytes: u64,
        /// The allocator's error.
        #[source]
        source: AllocationError,
    },
    /// Part of the scene cannot be read.
    #[error("the scene cannot be drawn")]
    Scene(#[source] ReadError),
    /// One drawable takes more memory than the budget of all.
    #[error(
        "a part of the scene takes {needed} bytes of the graphics device, and the budget is {budget}; \
         allow more (--gpu-memory)"
    )]
    WorkingSetTooSmall {
        /// Its bytes.
        needed: u64,
        /// The budget in bytes.
        budget: u64,
    },
    /// The picture is larger than the device can draw.
    #[error("a picture of {width} x {height} pixels is larger than this device's {limit} x {limit}")]
    ViewportTooLarge {
        /// The requested width.
        width: u32,
        /// The requested height.
        height: u32,
        /// The longest side that the device can draw.
        limit: u32,
    },
    /// The view of the boxes has another size than the picture that they are tested against.
    #[error(
        "boxes for a picture of {} x {} pixels against a depth of {} x {}: both must be of the view's size",
        view.width(), view.height(), depth.width(), depth.height()
    )]
    OtherSize {
        /// The view's size.
        view: Viewport,
        /// The depth's size.
        depth: Viewport,
    },
    /// Something was drawn or read before any view was set.
    #[error("{0} was used before it was given a view (call begin first)")]
    NotBegun(&'static str),
    /// A solid drawable was added after see-through ones, which would not be blended over it.
    #[error("solid drawables were added after see-through ones of the same frame: add them before")]
    SolidAfterSeeThrough,
    /// An id names no drawable of the scene.
    #[error("{id} is not in this scene, which has {count}")]
    UnknownDrawable {
        /// The id.
        id: DrawableId,
        /// The number of drawables in the scene.
        count: usize,
    },
    /// Any other Vulkan error.
    #[error("Vulkan failed while {operation}")]
    Vulkan {
        /// The operation.
        operation: &'static str,
        /// Vulkan's own code.
        #[source]
        source: vk::Result,
    },
}

impl GpuError {
    /// Whether the device is unusable: it was lost, or hangs. After any other error others can continue, and
    /// a too large request may be reduced.
    #[must_use]
    pub const fn is_lost(&self) -> bool {
        matches!(self, Self::DeviceLost { .. } | Self::DeviceHung { .. })
    }

    /// An error for Vulkan's code, with the operation named.
    pub(crate) const fn from_vk(operation: &'static str, code: vk::Result) -> Self {
        match code {
            vk::Result::ERROR_DEVICE_LOST => Self::DeviceLost { operation },
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
                Self::OutOfMemory { operation }
            }
            source => Self::Vulkan { operation, source },
        }
    }
}

/// Names the operation in the error of a Vulkan call.
pub(crate) trait During<T> {
    /// Converts Vulkan's code into a [`GpuError`] that names `operation`.
    fn during(self, operation: &'static str) -> Result<T, GpuError>;
}

impl<T> During<T> for Result<T, vk::Result> {
    fn during(self, operation: &'static str) -> Result<T, GpuError> {
        self.map_err(|code| GpuError::from_vk(operation, code))
    }
}
