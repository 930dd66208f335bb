//! Buffers and images: a handle and its memory, freed together.

use std::marker::PhantomData;
use std::sync::Arc;

use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use gpu_allocator::{AllocationError, MemoryLocation};
use trimaran_cull::Viewport;

use crate::error::During as _;
use crate::scope::Scope;
use crate::{Gpu, GpuError};

/// A buffer in memory of a requested kind. Submitted work that uses it must keep it alive until it is done.
pub(crate) struct Buffer {
    gpu: Arc<Gpu>,
    handle: vk::Buffer,
    allocation: Option<Allocation>,
    bytes: u64,
}

impl Buffer {
    /// A buffer of `bytes` bytes (at least one: Vulkan has no empty ones); `what` names it in errors.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        what: &'static str,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
        bytes: u64,
    ) -> Result<Self, GpuError> {
        let info = vk::BufferCreateInfo::default().size(bytes.max(1)).usage(usage);
        // SAFETY: the device is alive, the size is not 0, and the usage bits are core ones.
        let handle = unsafe { gpu.device().create_buffer(&info, None) }.during("making a buffer")?;
        // From here on a failure destroys what exists: see `Drop`.
        let mut buffer = Self { gpu: Arc::clone(gpu), handle, allocation: None, bytes };
        // SAFETY: the buffer was just made from this device.
        let requirements = unsafe { gpu.device().get_buffer_memory_requirements(handle) };
        let allocation = allocate(gpu, what, requirements, location, true)?;
        // SAFETY: the memory is of this device, meets the buffer's requirements, and nothing else is bound to
        // its range.
        let bound =
            unsafe { gpu.device().bind_buffer_memory(handle, allocation.memory(), allocation.offset()) };
        buffer.allocation = Some(allocation);
        bound.during("binding a buffer's memory")?;
        Ok(buffer)
    }

    pub(crate) const fn handle(&self) -> vk::Buffer {
        self.handle
    }

    /// Its size.
    #[cfg(test)]
    pub(crate) const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Whether the host sees its memory and can write to it without flushing. This may hold even if not
    /// requested: on a CPU driver it holds for all memory.
    pub(crate) fn is_writable(&self) -> bool {
        let writable = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        self.allocation.as_ref().is_some_and(|allocation| {
            allocation.memory_properties().contains(writable) && allocation.mapped_slice().is_some()
        })
    }

    /// Writes bytes from `offset` on, within the buffer, if it is [writable](Self::is_writable). Nothing may
    /// access them meanwhile: no work on the device, and no other thread.
    pub(crate) fn write(&self, offset: u64, bytes: &[u8]) {
        let room = self.bytes.saturating_sub(offset);
        let length = bytes.len().min(usize::try_from(room).unwrap_or(usize::MAX));
        let start = self.allocation.as_ref().and_then(Allocation::mapped_ptr);
        let Some(start) = start.filter(|_| self.is_writable()) else { return };
        // SAFETY: the memory is mapped for as long as the allocation lives, and the range lies within the
        // buffer, at whose start the pointer stands. Nobody else touches the range (see above), and no
        // reference to a writable buffer's bytes is given out beside those of a `HostBuffer`, which owns its
        // buffer.
        unsafe {
            let start = start.as_ptr().cast::<u8>().add(offset as usize);
            std::ptr::copy_nonoverlapping(bytes.as_ptr(), start, length);
        }
    }

    /// The buffer's memory, if it is [writable](Self::is_writable).
    fn mapped_mut(&mut self) -> Option<&mut [u8]> {
        let bytes = usize::try_from(self.bytes).ok()?;
        if !self.is_writable() {
            return None;
        }
        self.allocation.as_mut()?.mapped_slice_mut()?.get_mut(..bytes)
    }

    fn mapped(&self) -> Option<&[u8]> {
        self.allocation.as_ref()?.mapped_slice()
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let Some(device) = self.gpu.to_destroy() else { return };
        // SAFETY: work that uses the buffer is done (see the type); the handle is ours.
        unsafe { device.destroy_buffer(self.handle, None) };
        free(&self.gpu, self.allocation.take());
    }
}

/// A buffer of `T` that the host reads or writes in place.
pub(crate) struct HostBuffer<T> {
    buffer: Buffer,
    count: usize,
    element: PhantomData<T>,
}

impl<T: bytemuck::Pod> HostBuffer<T> {
    /// A buffer of `count` elements. `location` must be visible to the host.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        what: &'static str,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
        count: usize,
    ) -> Result<Self, GpuError> {
        let bytes = (count * size_of::<T>()) as u64;
        let mut buffer = Buffer::new(gpu, what, usage, location, bytes)?;
        let usable =
            buffer.mapped_mut().is_some_and(|bytes| bytemuck::try_cast_slice::<u8, T>(bytes).is_ok());
        if usable {
            Ok(Self { buffer, count, element: PhantomData })
        } else {
            let source = AllocationError::FailedToMap("the host cannot see it".to_owned());
            Err(GpuError::Allocation { what, bytes, source })
        }
    }

    pub(crate) const fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    pub(crate) const fn len(&self) -> usize {
        self.count
    }

    /// The elements as the device left them. The caller has waited for the device to finish writing.
    pub(crate) fn elements(&self) -> &[T] {
        let bytes = self.buffer.mapped().unwrap_or_default();
        bytemuck::cast_slice(bytes.get(..self.count * size_of::<T>()).unwrap_or_default())
    }

    /// The elements, to write. The caller writes none that the device may be reading.
    pub(crate) fn elements_mut(&mut self) -> &mut [T] {
        bytemuck::cast_slice_mut(self.buffer.mapped_mut().unwrap_or_default())
    }
}

/// The next use of an image: its layout, and the stages and accesses to order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ImageUse {
    Colour,
    Depth,
    CopySource,
}

impl ImageUse {
    pub(crate) const fn layout(self) -> vk::ImageLayout {
        match self {
            Self::Colour => vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
            Self::Depth => vk::ImageLayout::DEPTH_ATTACHMENT_OPTIMAL,
            Self::CopySource => vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
        }
    }

    pub(crate) fn scope(self) -> Scope {
        match self {
            Self::Colour => (
                vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT,
                vk::AccessFlags2::COLOR_ATTACHMENT_READ | vk::AccessFlags2::COLOR_ATTACHMENT_WRITE,
            ),
            Self::Depth => (
                vk::PipelineStageFlags2::EARLY_FRAGMENT_TESTS | vk::PipelineStageFlags2::LATE_FRAGMENT_TESTS,
                vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_READ
                    | vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_WRITE,
            ),
            Self::CopySource => (vk::PipelineStageFlags2::ALL_TRANSFER, vk::AccessFlags2::TRANSFER_READ),
        }
    }
}

/// An attachment of a pass: a 2D image that is drawn to and copied from. It tracks its last use for ordering
/// the next; all uses go through one stream.
pub(crate) struct Image {
    gpu: Arc<Gpu>,
    handle: vk::Image,
    view: vk::ImageView,
    allocation: Option<Allocation>,
    aspect: vk::ImageAspectFlags,
    pub(crate) last_use: Option<ImageUse>,
}

impl Image {
    /// An attachment of `size`. `what` names its purpose in errors.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        what: &'static str,
        format: vk::Format,
        size: Viewport,
    ) -> Result<Self, GpuError> {
        const BINDING: &str = "binding a picture's memory";
        let limit = gpu.info().max_viewport;
        let (width, height) = (size.width(), size.height());
        if width > limit || height > limit {
            return Err(GpuError::ViewportTooLarge { width, height, limit });
        }
        let (usage, aspect) = if format == vk::Format::D32_SFLOAT {
            (vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT, vk::ImageAspectFlags::DEPTH)
        } else {
            (vk::ImageUsageFlags::COLOR_ATTACHMENT, vk::ImageAspectFlags::COLOR)
        };
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(usage | vk::ImageUsageFlags::TRANSFER_SRC);
        // SAFETY: the sides are within the device's limits, and the formats used are ones Vulkan requires for
        // these usages, or that `needs` has asked for.
        let handle = unsafe { gpu.device().create_image(&info, None) }.during("making a picture")?;
        // From here on a failure destroys what exists: see `Drop`.
        let mut image = Self {
            gpu: Arc::clone(gpu),
            handle,
            view: vk::ImageView::null(),
            allocation: None,
            aspect,
            last_use: None,
        };
        // SAFETY: the image was just made from this device.
        let requirements = unsafe { gpu.device().get_image_memory_requirements(handle) };
        let allocation = allocate(gpu, what, requirements, MemoryLocation::GpuOnly, false)?;
        // SAFETY: the memory is of this device, meets the image's requirements, and nothing else is bound to
        // its range.
        let bound =
            unsafe { gpu.device().bind_image_memory(handle, allocation.memory(), allocation.offset()) };
        image.allocation = Some(allocation);
        bound.during(BINDING)?;
        let info = vk::ImageViewCreateInfo::default()
            .image(handle)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(whole(aspect));
        // SAFETY: the image is bound to memory and the view has its format.
        image.view = unsafe { gpu.device().create_image_view(&info, None) }.during(BINDING)?;
        Ok(image)
    }

    pub(crate) const fn handle(&self) -> vk::Image {
        self.handle
    }

    pub(crate) const fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    pub(crate) const fn view(&self) -> vk::ImageView {
        self.view
    }

    pub(crate) const fn aspect(&self) -> vk::ImageAspectFlags {
        self.aspect
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        let Some(device) = self.gpu.to_destroy() else { return };
        // SAFETY: the stream that used the image is done; the view (or null) and the image are ours.
        unsafe {
            device.destroy_image_view(self.view, None);
            device.destroy_image(self.handle, None);
        }
        free(&self.gpu, self.allocation.take());
    }
}

/// The only mip level and layer of an image.
pub(crate) const fn whole(aspect: vk::ImageAspectFlags) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange {
        aspect_mask: aspect,
        base_mip_level: 0,
        level_count: 1,
        base_array_layer: 0,
        layer_count: 1,
    }
}

/// The same for copies.
pub(crate) const fn layers(aspect: vk::ImageAspectFlags) -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers { aspect_mask: aspect, mip_level: 0, base_array_layer: 0, layer_count: 1 }
}

fn allocate(
    gpu: &Gpu,
    what: &'static str,
    requirements: vk::MemoryRequirements,
    location: MemoryLocation,
    linear: bool,
) -> Result<Allocation, GpuError> {
    gpu.allocator()
        .allocate(&AllocationCreateDesc {
            name: what,
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        })
        .map_err(|source| GpuError::Allocation { what, bytes: requirements.size, source })
}

fn free(gpu: &Gpu, allocation: Option<Allocation>) {
    let freed = allocation.map_or(Ok(()), |allocation| gpu.allocator().free(allocation));
    if let Err(error) = freed {
        tracing::error!(%error, "graphics memory could not be freed");
    }
}
