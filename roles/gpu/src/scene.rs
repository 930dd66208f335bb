//! A cooked scene in device memory.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::View;
use trimaran_proto::DrawableId;
use trimaran_scene::{Drawable, Node, Scene};

use crate::memory::{Buffer, HostBuffer};
use crate::stream::Stream;
use crate::{Gpu, GpuError};

/// The triangles of a scene on a device, and what of its tree drawing needs. Passes share it through an [`Arc`].
pub struct GpuScene {
    gpu: Arc<Gpu>,
    vertices: Buffer,
    indices: Buffer,
    drawables: Vec<DrawRange>,
    nodes: Vec<Placement>,
}

/// What drawing needs of a [`Drawable`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrawRange {
    pub(crate) index_count: u32,
    pub(crate) first_index: u32,
    pub(crate) vertex_offset: i32,
    pub(crate) node: u32,
}

/// What drawing needs of a [`Node`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placement {
    origin: [f64; 3],
    linear: [f32; 9],
}

impl GpuScene {
    /// Copies a scene's triangles to the device.
    ///
    /// # Errors
    /// If the scene is larger than the device can address or has memory for.
    pub fn upload(gpu: &Arc<Gpu>, scene: &Scene) -> Result<Arc<Self>, GpuError> {
        let vertices = upload(
            gpu,
            "vertices",
            vk::BufferUsageFlags::VERTEX_BUFFER,
            bytemuck::cast_slice(scene.vertices()),
        )?;
        let indices = upload(
            gpu,
            "indices",
            vk::BufferUsageFlags::INDEX_BUFFER,
            bytemuck::cast_slice(scene.indices()),
        )?;
        let drawables = scene.drawables().iter().map(DrawRange::new).collect::<Result<_, _>>()?;
        let nodes = scene.nodes().iter().map(Placement::new).collect();
        Ok(Arc::new(Self { gpu: Arc::clone(gpu), vertices, indices, drawables, nodes }))
    }

    /// The device that holds it.
    #[must_use]
    pub const fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Bytes of vertices and indices on the device.
    #[must_use]
    pub const fn bytes(&self) -> u64 {
        self.vertices.bytes() + self.indices.bytes()
    }

    pub(crate) const fn vertices(&self) -> &Buffer {
        &self.vertices
    }

    pub(crate) const fn indices(&self) -> &Buffer {
        &self.indices
    }

    /// A drawable's index range and its node's place.
    pub(crate) fn find(&self, id: DrawableId) -> Result<(&DrawRange, &Placement), GpuError> {
        self.drawables
            .get(id.index())
            .and_then(|range| Some((range, self.nodes.get(range.node as usize)?)))
            .ok_or(GpuError::UnknownDrawable { id, count: self.drawables.len() })
    }
}

impl std::fmt::Debug for GpuScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GpuScene").field("bytes", &self.bytes()).finish_non_exhaustive()
    }
}

impl DrawRange {
    fn new(drawable: &Drawable) -> Result<Self, GpuError> {
        let vertex_offset = i32::try_from(drawable.vertex_offset).map_err(|_| GpuError::SceneTooLarge {
            what: "vertices",
            bytes: u64::from(drawable.vertex_offset) * size_of::<trimaran_scene::Vertex>() as u64,
            limit: i32::MAX as u64 * size_of::<trimaran_scene::Vertex>() as u64,
        })?;
        Ok(Self {
            index_count: drawable.index_count,
            first_index: drawable.first_index,
            vertex_offset,
            node: drawable.node,
        })
    }
}

impl Placement {
    const fn new(node: &Node) -> Self {
        Self { origin: node.origin, linear: node.linear }
    }

    /// The map from the node's local frame to view space, as the rows of a 3x4 matrix: the one definition of where a vertex
    /// lies, used by every pass.
    ///
    /// World coordinates of plants are too large for f32, so the eye is subtracted and the rotation applied in f64, and each entry is
    /// rounded once, to f32, at the end: what is left of the error is about half an ulp of the *view-space* distance.
    pub(crate) fn in_view(&self, view: &View) -> [[f32; 4]; 3] {
        let rotation = view.to_view().to_cols_array();
        let eye = view.eye().to_array();
        let offset: [f64; 3] = std::array::from_fn(|i| self.origin[i] - eye[i]);
        std::array::from_fn(|row| {
            let r = [rotation[row], rotation[3 + row], rotation[6 + row]];
            let dot = |v: [f64; 3]| (r[0] * v[0] + r[1] * v[1] + r[2] * v[2]) as f32;
            let column = |c: usize| std::array::from_fn(|i| f64::from(self.linear[3 * c + i]));
            [dot(column(0)), dot(column(1)), dot(column(2)), dot(offset)]
        })
    }
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
