//! A window's surface, for presentation.

use std::sync::Arc;

use ash::{khr, vk};
use raw_window_handle::{HasDisplayHandle, HasWindowHandle};

use super::PresentMode;
use crate::error::During as _;
use crate::{Gpu, GpuError};

/// Makes the surface of a window, which it keeps alive.
pub(super) type MakeSurface = Box<dyn Fn(&Gpu) -> Result<vk::SurfaceKHR, vk::Result> + Send>;

/// The surface of a window.
pub(super) fn of_window(
    gpu: &Gpu,
    window: &(impl HasDisplayHandle + HasWindowHandle),
) -> Result<vk::SurfaceKHR, vk::Result> {
    let lost = |_| vk::Result::ERROR_SURFACE_LOST_KHR;
    let (display, handle) = (window.display_handle().map_err(lost)?, window.window_handle().map_err(lost)?);
    let (entry, instance, _) = gpu.platform();
    // SAFETY: both handles are valid, and stay so as long as the window, which the caller keeps for as long
    // as the surface; the instance has the extensions of the display (`Gpu::open_for_windows`).
    unsafe { ash_window::create_surface(entry, instance, display.as_raw(), handle.as_raw(), None) }
}

/// A window's surface, and its properties on the device.
pub(super) struct Surface {
    gpu: Arc<Gpu>,
    loader: khr::surface::Instance,
    handle: vk::SurfaceKHR,
}

/// The accepted formats of a window's images: the written values are sRGB already.
const FORMATS: [vk::Format; 2] = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];

impl Surface {
    /// A surface to which the device can present.
    pub(super) fn new(gpu: &Arc<Gpu>, make: &MakeSurface) -> Result<Self, GpuError> {
        let (entry, instance, physical) = gpu.platform();
        let handle = make(gpu).during("opening a window's surface")?;
        let loader = khr::surface::Instance::new(entry, instance);
        let surface = Self { gpu: Arc::clone(gpu), loader, handle };
        // SAFETY: the device and the surface are of this instance, and the device has this queue family.
        let presents = unsafe {
            surface.loader.get_physical_device_surface_support(physical, gpu.queue_family(), handle)
        };
        let usage = surface.capabilities().during(ASKING)?.supported_usage_flags;
        let lack = if !presents.during(ASKING)? {
            Some("its graphics queue does not present")
        } else if surface.format()?.is_none() {
            Some("its images have no format of 8 bits")
        } else if !usage.contains(vk::ImageUsageFlags::TRANSFER_DST) {
            Some("its images take no copies")
        } else {
            None
        };
        let device = || gpu.info().name.clone();
        lack.map_or(Ok(surface), |lack| Err(GpuError::CannotPresent { device: device(), lack }))
    }

    pub(super) const fn handle(&self) -> vk::SurfaceKHR {
        self.handle
    }

    /// Whether the window has the mode.
    pub(super) fn check(&self, mode: PresentMode) -> Result<(), GpuError> {
        let (_, _, physical) = self.gpu.platform();
        // SAFETY: device and surface are of one instance.
        let has = unsafe { self.loader.get_physical_device_surface_present_modes(physical, self.handle) };
        let has = has.during(ASKING)?;
        if has.contains(&mode.to_vk()) {
            return Ok(());
        }
        let found = PresentMode::ALL.into_iter().filter(|mode| has.contains(&mode.to_vk()));
        let found = found.map(PresentMode::name).collect::<Vec<_>>().join(", ");
        Err(GpuError::NoPresentMode { wanted: mode.name(), found })
    }

    /// The present size of its images, their possible number, and the like.
    pub(super) fn capabilities(&self) -> Result<vk::SurfaceCapabilitiesKHR, vk::Result> {
        let (_, _, physical) = self.gpu.platform();
        // SAFETY: device and surface are of one instance.
        unsafe { self.loader.get_physical_device_surface_capabilities(physical, self.handle) }
    }

    /// The format of its images, if one of the accepted ones.
    pub(super) fn format(&self) -> Result<Option<vk::Format>, GpuError> {
        let (_, _, physical) = self.gpu.platform();
        // SAFETY: device and surface are of one instance.
        let has = unsafe { self.loader.get_physical_device_surface_formats(physical, self.handle) };
        let has = has.during(ASKING)?;
        let is_there = |wanted: &vk::Format| {
            has.iter().any(|found| {
                found.format == *wanted && found.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR
            })
        };
        Ok(FORMATS.into_iter().find(is_there))
    }
}

const ASKING: &str = "asking what a window can show";

impl Drop for Surface {
    fn drop(&mut self) {
        if self.gpu.to_destroy().is_some() {
            // SAFETY: each swapchain of the surface holds an `Arc` of it, and is gone; the handle is ours.
            unsafe { self.loader.destroy_surface(self.handle, None) };
        }
    }
}
