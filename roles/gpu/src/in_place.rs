//! Arrays of a scene from a file that the device reads where they are.
//!
//! A driver that draws on the CPU reads the same memory as everyone else. A copy of the scene for each device
//! would only cost: for a scene of half a gigabyte and the three devices of a session in one process, most of
//! the time from the start to the first picture.

use std::ffi::c_void;
use std::mem::ManuallyDrop;
use std::sync::Arc;

use ash::vk;
use trimaran_scene::Scene;

use crate::error::During as _;
use crate::memory::{Backing, Buffer};
use crate::{Gpu, GpuError};

/// Scenes from files lie in whole pages, and these are at least as large.
const PAGE: u64 = 4096;

/// An array of a scene.
#[derive(Clone, Copy)]
pub(crate) struct SceneArray {
    pub(crate) name: &'static str,
    pub(crate) usage: vk::BufferUsageFlags,
    pub(crate) bytes: fn(&Scene) -> &[u8],
}

/// Pages of a mapped scene, known to a device as memory of its own that it never writes.
pub(crate) struct SceneMemory {
    gpu: Arc<Gpu>,
    handle: vk::DeviceMemory,
    // Keeps the pages mapped.
    scene: ManuallyDrop<Arc<Scene>>,
}

/// A buffer over an array of a scene. `None` where the device cannot read it in place: it is not from a file,
/// or the device has memory of its own.
pub(crate) fn buffer(gpu: &Arc<Gpu>, scene: &Arc<Scene>, array: SceneArray) -> Option<Buffer> {
    let alignment = gpu.limits().host_memory_alignment.filter(|&alignment| alignment <= PAGE)?;
    let bytes = (array.bytes)(scene);
    if !scene.is_mapped() || bytes.is_empty() {
        return None;
    }
    let start = bytes.as_ptr();
    let within = start.addr() as u64 % alignment;
    let pages = Pages {
        start: start.wrapping_sub(within as usize).cast_mut().cast(),
        length: (within + bytes.len() as u64).next_multiple_of(alignment),
    };
    match over_pages(gpu, scene, array, pages, within) {
        Ok(buffer) => Some(buffer),
        Err(error) => {
            tracing::debug!(%error, what = array.name, "the driver does not read the scene in place");
            None
        }
    }
}

/// Whole pages, some of them an array's.
#[derive(Clone, Copy)]
struct Pages {
    start: *mut c_void,
    length: u64,
}

fn over_pages(
    gpu: &Arc<Gpu>,
    scene: &Arc<Scene>,
    array: SceneArray,
    pages: Pages,
    within: u64,
) -> Result<Buffer, GpuError> {
    const OPERATION: &str = "reading the scene in place";
    let bytes = (array.bytes)(scene).len() as u64;
    let host = vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT;
    let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(host);
    let info = vk::BufferCreateInfo::default().size(bytes).usage(array.usage).push_next(&mut external);
    // SAFETY: the device is alive, the size is not 0, and the usage bits are core ones.
    let handle = unsafe { gpu.device().create_buffer(&info, None) }.during(OPERATION)?;
    // SAFETY: the buffer was just made from this device.
    let requirements = unsafe { gpu.device().get_buffer_memory_requirements(handle) };
    let memory = SceneMemory::import(gpu, scene, pages, requirements.memory_type_bits).and_then(|memory| {
        if !within.is_multiple_of(requirements.alignment) || within + requirements.size > pages.length {
            return Err(GpuError::from_vk(OPERATION, vk::Result::ERROR_INVALID_EXTERNAL_HANDLE));
        }
        // SAFETY: the memory is of this device and of a type the buffer takes, and the buffer's range lies in
        // it, aligned.
        unsafe { gpu.device().bind_buffer_memory(handle, memory.handle, within) }.during(OPERATION)?;
        Ok(memory)
    });
    match memory {
        Ok(memory) => Ok(Buffer::over(gpu, handle, Backing::Scene(memory), bytes)),
        Err(error) => {
            // SAFETY: the buffer is ours and nothing uses it.
            unsafe { gpu.device().destroy_buffer(handle, None) };
            Err(error)
        }
    }
}

impl SceneMemory {
    /// Pages of a mapped scene, as memory of one of the types.
    fn import(gpu: &Arc<Gpu>, scene: &Arc<Scene>, pages: Pages, types: u32) -> Result<Self, GpuError> {
        const OPERATION: &str = "sharing the scene with the device";
        let unknown = GpuError::from_vk(OPERATION, vk::Result::ERROR_INVALID_EXTERNAL_HANDLE);
        let Some(extension) = gpu.host_memory() else { return Err(unknown) };
        let host = vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT;
        let mut properties = vk::MemoryHostPointerPropertiesEXT::default();
        // SAFETY: the device has the extension, and the pages are mapped: the first and the last hold bytes
        // of the scene.
        unsafe {
            (extension.fp().get_memory_host_pointer_properties_ext)(
                gpu.device().handle(),
                host,
                pages.start,
                &raw mut properties,
            )
        }
        .result()
        .during(OPERATION)?;
        let usable = properties.memory_type_bits & types;
        if usable == 0 {
            return Err(unknown);
        }
        let mut import =
            vk::ImportMemoryHostPointerInfoEXT::default().handle_type(host).host_pointer(pages.start);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(pages.length)
            .memory_type_index(usable.trailing_zeros())
            .push_next(&mut import);
        // SAFETY: the pages are mapped for as long as the scene lives, which is kept, and nobody can change
        // or cut them meanwhile (`Scene::is_mapped`); address and length are multiples of what the
        // device asks for. They may be read-only: buffers over them are only ever read, as vertices
        // and indices.
        let handle = unsafe { gpu.device().allocate_memory(&info, None) }.during(OPERATION)?;
        Ok(Self { gpu: Arc::clone(gpu), handle, scene: ManuallyDrop::new(Arc::clone(scene)) })
    }
}

impl Drop for SceneMemory {
    fn drop(&mut self) {
        let Some(device) = self.gpu.to_destroy() else { return };
        // SAFETY: ours; the buffer over it is gone, and with it all work that used it. The scene is dropped
        // once.
        unsafe {
            device.free_memory(self.handle, None);
            ManuallyDrop::drop(&mut self.scene);
        }
    }
}
