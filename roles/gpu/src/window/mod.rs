//! Pictures in a window of the system: the device copies them to the window's images, without the host.

mod surface;
mod swapchain;

use std::sync::Arc;

use ash::{khr, vk};
use raw_window_handle::{HasDisplayHandle, HasWindowHandle};
use trimaran_cull::Viewport;

use crate::error::During as _;
use crate::{Gpu, GpuError};
use surface::{MakeSurface, Surface};
use swapchain::Swapchain;

/// When a new picture replaces the shown one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum PresentMode {
    /// At the screen's next refresh, each in its turn. Every window has this mode.
    #[default]
    Fifo,
    /// At the screen's next refresh, the newest one. Older ones are never shown.
    Mailbox,
    /// At once, in the middle of a refresh as well: the picture may be torn.
    Immediate,
}

impl PresentMode {
    /// Every mode.
    pub const ALL: [Self; 3] = [Self::Fifo, Self::Mailbox, Self::Immediate];

    /// Vulkan's name for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fifo => "fifo",
            Self::Mailbox => "mailbox",
            Self::Immediate => "immediate",
        }
    }

    const fn to_vk(self) -> vk::PresentModeKHR {
        match self {
            Self::Fifo => vk::PresentModeKHR::FIFO,
            Self::Mailbox => vk::PresentModeKHR::MAILBOX,
            Self::Immediate => vk::PresentModeKHR::IMMEDIATE,
        }
    }
}

/// A window's inside in pixels of the screen; 0 on both sides while it is minimized.
pub type WindowSize = [u32; 2];

/// How long to wait for a free image of a window, before the caller handles other things.
const ACQUIRE_NS: u64 = 100_000_000;

/// Presents pictures in one window: see [`PicturePass::present`](crate::PicturePass::present).
///
/// When the window is resized, minimized or moved to another screen, its images are made anew if necessary.
pub struct Presenter {
    gpu: Arc<Gpu>,
    loader: khr::swapchain::Device,
    make_surface: MakeSurface,
    surface: Arc<Surface>,
    mode: PresentMode,
    swapchain: Option<Arc<Swapchain>>,
    /// The images no longer fit the window.
    is_stale: bool,
    acquired: Option<Acquired>,
}

/// An image of the window to fill.
#[derive(Clone)]
pub(crate) struct Acquired {
    /// The owner of the image: kept until the image is filled.
    pub(crate) swapchain: Arc<Swapchain>,
    index: u32,
    pub(crate) image: vk::Image,
    pub(crate) extent: vk::Extent2D,
    /// Signalled when the image may be filled.
    pub(crate) available: vk::Semaphore,
    /// To be signalled when it is filled.
    pub(crate) filled: vk::Semaphore,
}

impl Presenter {
    /// Presents pictures of a device that was [opened for windows](Gpu::open_for_windows).
    ///
    /// # Errors
    /// If the device cannot present there, or the window lacks the mode.
    pub fn new<W>(gpu: &Arc<Gpu>, window: Arc<W>, mode: PresentMode) -> Result<Self, GpuError>
    where
        W: HasDisplayHandle + HasWindowHandle + Send + Sync + 'static,
    {
        Self::with(gpu, Box::new(move |gpu| surface::of_window(gpu, &*window)), mode)
    }

    fn with(gpu: &Arc<Gpu>, make_surface: MakeSurface, mode: PresentMode) -> Result<Self, GpuError> {
        let surface = Arc::new(Surface::new(gpu, &make_surface)?);
        surface.check(mode)?;
        let (_, instance, _) = gpu.platform();
        let loader = khr::swapchain::Device::new(instance, gpu.device());
        let (gpu, acquired) = (Arc::clone(gpu), None);
        Ok(Self { gpu, loader, make_surface, surface, mode, swapchain: None, is_stale: true, acquired })
    }

    /// Acquires an image of the window, whose inner size is given, and returns the size of the picture to
    /// draw. `None` if nothing can be shown now: the window is minimized, or all its images are in use. Waits
    /// a tenth of a second at most.
    ///
    /// # Errors
    /// If the device fails.
    pub fn acquire(&mut self, window: WindowSize) -> Result<Option<Viewport>, GpuError> {
        if self.acquired.is_none() {
            // An image may be outdated again at once, while the window is being resized.
            for _ in 0..3 {
                if !self.fit(window)? {
                    return Ok(None);
                }
                if self.take_image()? {
                    break;
                }
                if !self.is_stale {
                    return Ok(None);
                }
            }
        }
        let size = self.acquired.as_ref().map(|acquired| acquired.extent);
        Ok(size.and_then(|extent| Viewport::new(extent.width, extent.height).ok()))
    }

    pub(crate) fn acquired(&mut self) -> Option<Acquired> {
        self.acquired.take()
    }

    /// Presents the image, once it is filled.
    pub(crate) fn present(
        &mut self,
        Acquired { swapchain, index, filled, .. }: &Acquired,
    ) -> Result<(), GpuError> {
        let (swapchains, indices, waits) = ([swapchain.handle()], [*index], [*filled]);
        let info = vk::PresentInfoKHR::default()
            .wait_semaphores(&waits)
            .swapchains(&swapchains)
            .image_indices(&indices);
        let queue = self.gpu.queue();
        // SAFETY: the queue is locked, and of a family that presents to the surface; the image was acquired,
        // and work that signals the semaphore and leaves the image ready was submitted.
        let shown = unsafe { self.loader.queue_present(*queue, &info) };
        drop(queue);
        self.note(shown)?;
        Ok(())
    }

    /// Makes images that fit the window if there are none. Returns whether there are any.
    fn fit(&mut self, window: WindowSize) -> Result<bool, GpuError> {
        let fits = |swapchain: &Arc<Swapchain>| swapchain.window() == window;
        if !self.is_stale && self.swapchain.as_ref().is_some_and(fits) {
            return Ok(true);
        }
        let old = self.swapchain.take();
        let made = Swapchain::new(&self.gpu, &self.loader, &self.surface, self.mode, window, old.as_deref());
        match made {
            Ok(made) => self.swapchain = made.map(Arc::new),
            Err(vk::Result::ERROR_SURFACE_LOST_KHR | vk::Result::ERROR_NATIVE_WINDOW_IN_USE_KHR) => {
                drop(old);
                match Surface::new(&self.gpu, &self.make_surface) {
                    Ok(surface) => self.surface = Arc::new(surface),
                    // The window itself is gone: its owner will be told.
                    Err(GpuError::Vulkan { source: vk::Result::ERROR_SURFACE_LOST_KHR, .. }) => {}
                    Err(error) => return Err(error),
                }
            }
            Err(code) => return Err(GpuError::from_vk("making a window's images", code)),
        }
        self.is_stale = self.swapchain.is_none();
        Ok(!self.is_stale)
    }

    /// Acquires an image, if there is a free one.
    fn take_image(&mut self) -> Result<bool, GpuError> {
        let Some(swapchain) = &self.swapchain else { return Ok(false) };
        let available = swapchain.next_available();
        // SAFETY: the semaphore is of this device, and no signal or wait of it is pending: see
        // `Swapchain::next_available`.
        let taken = unsafe {
            self.loader.acquire_next_image(swapchain.handle(), ACQUIRE_NS, available, vk::Fence::null())
        };
        self.acquired = taken.ok().and_then(|(index, _)| swapchain.acquired(index, available));
        let usable = self.note(taken.map(|(_, suboptimal)| suboptimal))?;
        Ok(usable && self.acquired.is_some())
    }

    /// Notes a call's result for the images. Returns whether the call has succeeded.
    fn note(&mut self, said: Result<bool, vk::Result>) -> Result<bool, GpuError> {
        match said {
            Ok(suboptimal) => {
                self.is_stale |= suboptimal;
                Ok(true)
            }
            Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => Ok(false),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR | vk::Result::ERROR_SURFACE_LOST_KHR) => {
                self.is_stale = true;
                Ok(false)
            }
            Err(code) => Err(code).during("showing a picture"),
        }
    }
}
