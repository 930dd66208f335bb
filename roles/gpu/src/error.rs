//! What can go wrong between this process and a graphics device.

use std::time::Duration;

use ash::vk;
use gpu_allocator::AllocationError;
use thiserror::Error;
use trimaran_cull::Viewport;
use trimaran_proto::DrawableId;
use trimaran_scene::ReadError;

/// Why a graphics operation failed. Each message says what was being done, and what to do where something can
/// be done.
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
    /// Validation was asked for and its layer is not installed.
    #[error(
        "the Vulkan validation layer is not installed; install it (Debian and Ubuntu: apt install \
         vulkan-validationlayers) or open the device without validation"
    )]
    NoValidationLayer,
    /// Vulkan has no windows of this kind here.
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
        /// What it lacks.
        lack: &'static str,
    },
    /// The window's driver does not know the present mode asked for.
    #[error("this window has no present mode {wanted}: it has {found}")]
    NoPresentMode {
        /// The name asked for.
        wanted: &'static str,
        /// The names of those it has.
        found: String,
    },
    /// No device has the name asked for, or none is a CPU device where one was asked for.
    #[error("no Vulkan device matches {wanted}; this machine has: {found}")]
    NoSuchDevice {
        /// What was asked for.
        wanted: String,
        /// The names of the devices there are.
        found: String,
    },
    /// Devices match, but each lacks something this crate needs.
    #[error("the Vulkan device {device} lacks {missing}; a newer driver may have it")]
    Unsuitable {
        /// The name of the best device that matched.
        device: String,
        /// What it lacks, by Vulkan's own names.
        missing: String,
    },
    /// The device was lost: the driver crashed, was reset, or was taken away. Open it anew.
    #[error("the graphics device was lost while {operation}; open it again")]
    DeviceLost {
        /// What was being done.
        operation: &'static str,
    },
    /// The device has finished nothing for the timeout of [`GpuOptions`](crate::GpuOptions). It does nothing
    /// more for this process.
    #[error(
        "the graphics device hangs: no progress within {timeout:?} while {operation}; look at the driver's \
         messages (dmesg), start again, or wait longer if the device is only slow (--device-timeout)"
    )]
    DeviceHung {
        /// What was being done.
        operation: &'static str,
        /// How long nothing was finished.
        timeout: Duration,
    },
    /// Whoever runs the pass asked to end the wait. The pass cannot go on; another one on the same device
    /// can.
    #[error("asked to stop while {operation}")]
    Cancelled {
        /// What was being done.
        operation: &'static str,
    },
    /// Host or device memory ran out.
    #[error("out of memory while {operation}")]
    OutOfMemory {
        /// What was being done.
        operation: &'static str,
    },
    /// Memory for one buffer or image could not be had.
    #[error("no memory on the graphics device for {what} ({bytes} bytes)")]
    Allocation {
        /// What the memory was for.
        what: &'static str,
        /// How much was asked for.
        bytes: u64,
        /// What the allocator says.
        #[source]
        source: AllocationError,
    },
    /// Part of the scene cannot be read.
    #[error("the scene cannot be drawn")]
    Scene(#[source] ReadError),
    /// One drawable takes more memory than all of them may.
    #[error(
        "a part of the scene takes {needed} bytes of the graphics device, and the budget is {budget}; \
         allow more (--gpu-memory)"
    )]
    WorkingSetTooSmall {
        /// What it takes, in bytes.
        needed: u64,
        /// The budget in bytes.
        budget: u64,
    },
    /// The picture is larger than the device can draw.
    #[error("a picture of {width} x {height} pixels is larger than this device's {limit} x {limit}")]
    ViewportTooLarge {
        /// The width asked for.
        width: u32,
        /// The height asked for.
        height: u32,
        /// The longest side the device can draw.
        limit: u32,
    },
    /// Boxes are seen from a view of another size than the picture they are tested against.
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
    /// Something solid was to be drawn over see-through drawables, where it would not shine through them.
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
        /// What was being done.
        operation: &'static str,
        /// Vulkan's own code.
        #[source]
        source: vk::Result,
    },
}

impl GpuError {
    /// Whether nothing more can be done with the device: it was lost, or hangs. After any other error others
    /// go on with it, and whoever asked for too much may ask for less.
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
    /// Turns Vulkan's code into a [`GpuError`] that says it happened while `operation` went on.
    fn during(self, operation: &'static str) -> Result<T, GpuError>;
}

impl<T> During<T> for Result<T, vk::Result> {
    fn during(self, operation: &'static str) -> Result<T, GpuError> {
        self.map_err(|code| GpuError::from_vk(operation, code))
    }
}
