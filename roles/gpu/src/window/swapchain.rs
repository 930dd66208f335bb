//! A window's swapchain.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use ash::{khr, vk};

use super::surface::Surface;
use super::{Acquired, PresentMode, WindowSize};
use crate::Gpu;

/// Semaphores of acquired images. A picture pass has two pictures under way, and waits for a third one before
/// it begins another: so one more than that is never still in use.
const AVAILABLE: usize = 3;

/// Images of a window of one size. Work that fills one of them holds an [`Arc`] of it until that is done.
pub(crate) struct Swapchain {
    gpu: Arc<Gpu>,
    loader: khr::swapchain::Device,
    handle: vk::SwapchainKHR,
    images: Vec<vk::Image>,
    extent: vk::Extent2D,
    window: WindowSize,
    available: Vec<vk::Semaphore>,
    next: AtomicUsize,
    /// One per image: it is acquired again only after its presentation has waited.
    filled: Vec<vk::Semaphore>,
    // Dropped after the images, which belong to it.
    _surface: Arc<Surface>,
}

impl Swapchain {
    /// Images for a window of this inner size; `None` if that is zero at present. The images of `old` are
    /// presented no more.
    pub(super) fn new(
        gpu: &Arc<Gpu>,
        loader: &khr::swapchain::Device,
        surface: &Arc<Surface>,
        mode: PresentMode,
        window: WindowSize,
        old: Option<&Self>,
    ) -> Result<Option<Self>, vk::Result> {
        let capabilities = surface.capabilities()?;
        let extent = extent(&capabilities, window);
        let format = surface.format().map_err(|_| vk::Result::ERROR_SURFACE_LOST_KHR)?;
        let (Some(format), true) = (format, extent.width > 0 && extent.height > 0) else { return Ok(None) };
        let most = if capabilities.max_image_count == 0 { u32::MAX } else { capabilities.max_image_count };
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(surface.handle())
            .min_image_count(capabilities.min_image_count.saturating_add(1).min(most))
            .image_format(format)
            .image_color_space(vk::ColorSpaceKHR::SRGB_NONLINEAR)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(capabilities.current_transform)
            .composite_alpha(alpha(capabilities.supported_composite_alpha))
            .present_mode(mode.to_vk())
            .clipped(true)
            .old_swapchain(old.map_or(vk::SwapchainKHR::null(), |old| old.handle));
        // SAFETY: the surface lives, and the request is within its capabilities; the old swapchain, if there
        // is one, is of the same surface or of one that is lost.
        let handle = unsafe { loader.create_swapchain(&info, None) }?;
        // From here on a failure destroys what exists: see `Drop`.
        let mut made = Self {
            gpu: Arc::clone(gpu),
            loader: loader.clone(),
            handle,
            images: Vec::new(),
            extent,
            window,
            available: Vec::new(),
            next: AtomicUsize::new(0),
            filled: Vec::new(),
            _surface: Arc::clone(surface),
        };
        // SAFETY: the swapchain was just made.
        made.images = unsafe { loader.get_swapchain_images(handle) }?;
        // SAFETY: the device is alive.
        let semaphore =
            || unsafe { gpu.device().create_semaphore(&vk::SemaphoreCreateInfo::default(), None) };
        for _ in 0..AVAILABLE {
            made.available.push(semaphore()?);
        }
        for _ in 0..made.images.len() {
            made.filled.push(semaphore()?);
        }
        Ok(Some(made))
    }

    pub(super) const fn handle(&self) -> vk::SwapchainKHR {
        self.handle
    }

    /// The size of the window for which it was made.
    pub(super) const fn window(&self) -> WindowSize {
        self.window
    }

    /// The semaphore to acquire the next image with. No signal or wait of it is pending: work that waited for
    /// it is done.
    pub(super) fn next_available(&self) -> vk::Semaphore {
        let next = self.next.load(Ordering::Relaxed);
        self.available.get(next).copied().unwrap_or_default()
    }

    /// The image acquired with this semaphore.
    pub(super) fn acquired(self: &Arc<Self>, index: u32, available: vk::Semaphore) -> Option<Acquired> {
        let next = (self.next.load(Ordering::Relaxed) + 1) % AVAILABLE;
        self.next.store(next, Ordering::Relaxed);
        let (image, filled) = (self.images.get(index as usize)?, self.filled.get(index as usize)?);
        let (image, filled) = (*image, *filled);
        Some(Acquired { swapchain: Arc::clone(self), index, image, extent: self.extent, available, filled })
    }
}

/// The size of the images: the window's own if it is defined, else the requested one.
fn extent(capabilities: &vk::SurfaceCapabilitiesKHR, window: WindowSize) -> vk::Extent2D {
    let known = capabilities.current_extent;
    if known.width != u32::MAX {
        return known;
    }
    if window.contains(&0) {
        return vk::Extent2D::default();
    }
    let (least, most) = (capabilities.min_image_extent, capabilities.max_image_extent);
    vk::Extent2D {
        width: window[0].max(least.width).min(most.width),
        height: window[1].max(least.height).min(most.height),
    }
}

/// Opaque composition, if the system supports it.
fn alpha(supported: vk::CompositeAlphaFlagsKHR) -> vk::CompositeAlphaFlagsKHR {
    if supported.contains(vk::CompositeAlphaFlagsKHR::OPAQUE) {
        vk::CompositeAlphaFlagsKHR::OPAQUE
    } else {
        vk::CompositeAlphaFlagsKHR::INHERIT
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        let Some(device) = self.gpu.to_destroy() else { return };
        let queue = self.gpu.queue();
        // SAFETY: work that fills an image holds an `Arc` of this until it is done, so that the queue has
        // only presentations of it left. It is locked, and waited for, before images and semaphores go. A
        // lost device presents nothing any more.
        unsafe {
            let _lost = device.queue_wait_idle(*queue);
            for semaphore in self.available.iter().chain(&self.filled) {
                device.destroy_semaphore(*semaphore, None);
            }
            self.loader.destroy_swapchain(self.handle, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn capabilities(known: [u32; 2]) -> vk::SurfaceCapabilitiesKHR {
        let extent = |[width, height]: [u32; 2]| vk::Extent2D { width, height };
        vk::SurfaceCapabilitiesKHR {
            current_extent: extent(known),
            min_image_extent: extent([1, 1]),
            max_image_extent: extent([4096, 2048]),
            ..Default::default()
        }
    }

    #[test]
    fn images_are_as_large_as_the_window_as_far_as_that_goes() {
        let size = |known, window| {
            let vk::Extent2D { width, height } = extent(&capabilities(known), window);
            [width, height]
        };
        let unknown = [u32::MAX; 2];
        assert_eq!(size([640, 480], [800, 600]), [640, 480], "the window is smaller by now");
        assert_eq!(size(unknown, [800, 600]), [800, 600]);
        assert_eq!(size(unknown, [9000, 9000]), [4096, 2048]);
        assert_eq!(size(unknown, [0, 0]), [0, 0], "minimized");
        assert_eq!(size([0, 0], [800, 600]), [0, 0], "minimized already");
    }

    #[test]
    fn nothing_shines_through_the_window_where_it_may_say_so() {
        use vk::CompositeAlphaFlagsKHR as Alpha;
        assert_eq!(alpha(Alpha::OPAQUE | Alpha::INHERIT), Alpha::OPAQUE);
        assert_eq!(alpha(Alpha::INHERIT), Alpha::INHERIT);
    }
}
