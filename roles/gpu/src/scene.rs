//! A cooked scene in device memory.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::View;
use trimaran_proto::DrawableId;
use trimaran_scene::{Drawable, Node, Scene, Vertex};

use crate::in_place::{self, SceneArray};
use crate::memory::{Buffer, HostBuffer};
use crate::stream::Stream;
use crate::{Gpu, GpuError};

/// The triangles of a scene on a device, and the scene itself for what of its tree drawing needs. Passes
/// share it through an [`Arc`].
pub struct GpuScene {
    gpu: Arc<Gpu>,
    vertices: Buffer,
    indices: Buffer,
    scene: Arc<Scene>,
}

const VERTICES: SceneArray = SceneArray {
    name: "vertices",
    usage: vk::BufferUsageFlags::VERTEX_BUFFER,
    bytes: |scene| bytemuck::cast_slice(scene.vertices()),
};

const INDICES: SceneArray = SceneArray {
    name: "indices",
    usage: vk::BufferUsageFlags::INDEX_BUFFER,
    bytes: |scene| bytemuck::cast_slice(scene.indices()),
};

impl SceneArray {
    /// Whether it fits a storage buffer of the device.
    fn can_be_pulled(self, gpu: &Gpu, scene: &Scene) -> bool {
        (self.bytes)(scene).len() as u64 <= gpu.limits().max_storage_range
    }
}

impl GpuScene {
    /// Gives a scene's triangles to the device: a copy, or where it draws on the CPU and the scene is mapped
    /// from a file, the file's own pages.
    ///
    /// # Errors
    /// If the scene is larger than the device can address or has memory for.
    pub fn upload(gpu: &Arc<Gpu>, scene: &Arc<Scene>) -> Result<Arc<Self>, GpuError> {
        let last_offset = scene.drawables().iter().map(|drawable| drawable.vertex_offset).max();
        if let Some(offset) = last_offset.filter(|&offset| i32::try_from(offset).is_err()) {
            let size = size_of::<Vertex>() as u64;
            let (bytes, limit) = (u64::from(offset) * size, i32::MAX as u64 * size);
            return Err(GpuError::SceneTooLarge { what: VERTICES.name, bytes, limit });
        }
        let on_device = |mut array: SceneArray| {
            if array.can_be_pulled(gpu, scene) {
                array.usage |= vk::BufferUsageFlags::STORAGE_BUFFER;
            }
            match in_place::buffer(gpu, scene, array) {
                Some(buffer) => Ok(buffer),
                None => upload(gpu, array.name, array.usage, (array.bytes)(scene)),
            }
        };
        let (vertices, indices) = (on_device(VERTICES)?, on_device(INDICES)?);
        Ok(Arc::new(Self { gpu: Arc::clone(gpu), vertices, indices, scene: Arc::clone(scene) }))
    }

    /// Whether shaders may fetch vertices from it; an error that names what is too large if not.
    pub(crate) fn check_pulled(&self) -> Result<(), GpuError> {
        for array in [VERTICES, INDICES] {
            if !array.can_be_pulled(&self.gpu, &self.scene) {
                let bytes = (array.bytes)(&self.scene).len() as u64;
                let limit = self.gpu.limits().max_storage_range;
                return Err(GpuError::SceneTooLarge { what: array.name, bytes, limit });
            }
        }
        Ok(())
    }

    /// The device that holds it.
    #[must_use]
    pub const fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Bytes that were copied for the device: those of vertices and indices, or none where it reads the
    /// scene's own.
    #[must_use]
    pub fn copied_bytes(&self) -> u64 {
        [&self.vertices, &self.indices].map(Buffer::own_bytes).iter().sum()
    }

    pub(crate) const fn vertices(&self) -> &Buffer {
        &self.vertices
    }

    pub(crate) const fn indices(&self) -> &Buffer {
        &self.indices
    }

    /// A drawable and its node.
    pub(crate) fn find(&self, id: DrawableId) -> Result<(&Drawable, &Node), GpuError> {
        let drawables = self.scene.drawables();
        drawables
            .get(id.index())
            .and_then(|drawable| Some((drawable, self.scene.nodes().get(drawable.node as usize)?)))
            .ok_or(GpuError::UnknownDrawable { id, count: drawables.len() })
    }
}

impl std::fmt::Debug for GpuScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GpuScene").field("copied_bytes", &self.copied_bytes()).finish_non_exhaustive()
    }
}

/// The map from a node's local frame to view space, as the rows of a 3x4 matrix: the one definition of where
/// a vertex lies, used by every pass.
///
/// World coordinates of plants are too large for f32, so the eye is subtracted and the rotation applied in
/// f64, and each entry is rounded once, to f32, at the end: what is left of the error is about half an ulp of
/// the *view-space* distance.
pub(crate) fn in_view(node: &Node, view: &View) -> [[f32; 4]; 3] {
    let rotation = view.to_view().to_cols_array();
    let eye = view.eye().to_array();
    let offset: [f64; 3] = std::array::from_fn(|i| node.origin[i] - eye[i]);
    std::array::from_fn(|row| {
        let r = [rotation[row], rotation[3 + row], rotation[6 + row]];
        let dot = |v: [f64; 3]| (r[0] * v[0] + r[1] * v[1] + r[2] * v[2]) as f32;
        let column = |c: usize| std::array::from_fn(|i| f64::from(node.linear[3 * c + i]));
        [dot(column(0)), dot(column(1)), dot(column(2)), dot(offset)]
    })
}

/// How much is copied at a time where the device's own memory cannot be written in place.
const STAGING_BYTES: usize = 16 << 20;

/// Copies `content` into a buffer in the device's own memory.
fn upload(
    gpu: &Arc<Gpu>,
    what: &'static str,
    usage: vk::BufferUsageFlags,
    content: &[u8],
) -> Result<Buffer, GpuError> {
    let bytes = content.len() as u64;
    let limit = gpu.limits().max_allocation;
    if bytes > limit {
        return Err(GpuError::SceneTooLarge { what, bytes, limit });
    }
    let usage = usage | vk::BufferUsageFlags::TRANSFER_DST;
    let mut buffer = Buffer::new(gpu, what, usage, MemoryLocation::GpuOnly, bytes)?;
    if let Some(mapped) = buffer.mapped_mut() {
        mapped.copy_from_slice(content);
        return Ok(buffer);
    }
    // Declared first, so that on an error it waits before the staging buffer goes.
    let mut stream = Stream::new(gpu)?;
    let mut staging = HostBuffer::<u8>::new(
        gpu,
        "staging",
        vk::BufferUsageFlags::TRANSFER_SRC,
        MemoryLocation::CpuToGpu,
        STAGING_BYTES.min(content.len()),
    )?;
    for (index, chunk) in content.chunks(STAGING_BYTES).enumerate() {
        if let Some(target) = staging.elements_mut().get_mut(..chunk.len()) {
            target.copy_from_slice(chunk);
        }
        let offset = (index * STAGING_BYTES) as u64;
        stream.submit("uploading the scene", |commands| {
            commands.copy(staging.buffer(), &buffer, offset, chunk.len() as u64);
            commands.barrier(
                (vk::PipelineStageFlags2::COPY, vk::AccessFlags2::TRANSFER_WRITE),
                (vk::PipelineStageFlags2::ALL_COMMANDS, vk::AccessFlags2::MEMORY_READ),
            );
        })?;
        stream.wait("uploading the scene")?;
    }
    Ok(buffer)
}
