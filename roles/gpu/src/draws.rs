//! The draws of a frame: one record and one indirect command each, in buffers that the device reads in place.
//!
//! A record is an instance's vertex attributes. Each draw is one instance, whose number (its first instance) picks the record.

use std::ops::Range;
use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::View;
use trimaran_proto::DrawableId;

use crate::memory::HostBuffer;
use crate::recorder::Recorder;
use crate::scene::in_view;
use crate::{Gpu, GpuError, GpuScene};

/// The draws of one frame, in the order given. Those already submitted stay as they are until [`clear`](Self::clear).
pub(crate) struct Draws {
    gpu: Arc<Gpu>,
    chunks: Vec<Chunk>,
    /// Draws since the frame began, and how many of them were recorded.
    added: usize,
    recorded: usize,
}

/// Draws that share an indirect call: far below the 65 thousand commands that every device takes in one.
const CHUNK: usize = 16_384;

struct Chunk {
    records: HostBuffer<DrawRecord>,
    commands: HostBuffer<DrawCommand>,
}

/// What the shaders know of a draw: `Draw` of scene.wgsl and the id.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct DrawRecord {
    /// Local frame to view space: the rows of a 3x4 matrix.
    pub(crate) to_view: [[f32; 4]; 3],
    /// The drawable.
    pub(crate) id: u32,
}

/// `VkDrawIndexedIndirectCommand`.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct DrawCommand {
    index_count: u32,
    instance_count: u32,
    first_index: u32,
    vertex_offset: i32,
    first_instance: u32,
}

impl Draws {
    /// No draws yet.
    pub(crate) const fn new(gpu: Arc<Gpu>) -> Self {
        Self { gpu, chunks: Vec::new(), added: 0, recorded: 0 }
    }

    /// Forgets all draws. The caller has waited for the device to finish them.
    pub(crate) const fn clear(&mut self) {
        (self.added, self.recorded) = (0, 0);
    }

    /// Whether there are draws that were not recorded.
    pub(crate) const fn has_news(&self) -> bool {
        self.recorded < self.added
    }

    /// Adds one draw an id, as seen from `view`. An id that the scene does not have is an error, and none of the ids after it
    /// is added.
    pub(crate) fn add(&mut self, scene: &GpuScene, view: &View, ids: &[DrawableId]) -> Result<(), GpuError> {
        let mut rest = ids;
        while !rest.is_empty() {
            let slot = self.added % CHUNK;
            let (now, later) = rest.split_at(rest.len().min(CHUNK - slot));
            let chunk = self.chunk(self.added / CHUNK)?;
            let (Some(records), Some(commands)) =
                (chunk.records.elements_mut().get_mut(slot..), chunk.commands.elements_mut().get_mut(slot..))
            else {
                return Ok(()); // a chunk has CHUNK of both
            };
            for (first_instance, ((record, command), &id)) in
                (slot as u32..).zip(records.iter_mut().zip(commands).zip(now))
            {
                let (drawable, node) = scene.find(id)?;
                *record = DrawRecord { to_view: in_view(node, view), id: id.0 };
                *command = DrawCommand {
                    index_count: drawable.index_count,
                    instance_count: 1,
                    first_index: drawable.first_index,
                    vertex_offset: drawable.vertex_offset as i32, // `GpuScene::upload` has seen that it fits
                    first_instance,
                };
            }
            self.added += now.len();
            rest = later;
        }
        Ok(())
    }

    /// Records the draws added since the last time: one indirect call a chunk.
    pub(crate) fn record(&mut self, commands: &Recorder<'_>) {
        for (chunk, part) in parts(self.recorded..self.added) {
            if let Some(chunk) = self.chunks.get(chunk) {
                commands.bind_instances(chunk.records.buffer());
                commands.draw_indexed_indirect(chunk.commands.buffer(), part.start, part.len());
            }
        }
        self.recorded = self.added;
    }

    /// The chunk of this index, which exists or is the next one to make.
    fn chunk(&mut self, index: usize) -> Result<&mut Chunk, GpuError> {
        if index >= self.chunks.len() {
            self.chunks.push(Chunk::new(&self.gpu)?);
        }
        let last = self.chunks.len() - 1;
        Ok(&mut self.chunks[index.min(last)])
    }
}

impl Chunk {
    fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let here = MemoryLocation::CpuToGpu;
        let records = HostBuffer::new(gpu, "draw records", vk::BufferUsageFlags::VERTEX_BUFFER, here, CHUNK)?;
        let commands =
            HostBuffer::new(gpu, "draw commands", vk::BufferUsageFlags::INDIRECT_BUFFER, here, CHUNK)?;
        Ok(Self { records, commands })
    }
}

/// Splits a range of draws at the chunks' ends: chunk, and range within it.
fn parts(draws: Range<usize>) -> impl Iterator<Item = (usize, Range<usize>)> {
    (draws.start / CHUNK..draws.end.div_ceil(CHUNK)).map(move |chunk| {
        let base = chunk * CHUNK;
        (chunk, draws.start.max(base) - base..draws.end.min(base + CHUNK) - base)
    })
}

#[cfg(test)]
mod tests {
    use super::{CHUNK, parts};

    #[test]
    fn parts_cover_a_range_once_and_cross_no_chunk() {
        assert_eq!(parts(0..0).count(), 0);
        assert_eq!(parts(5..5).map(|(_, part)| part.len()).sum::<usize>(), 0);
        assert_eq!(parts(3..CHUNK).collect::<Vec<_>>(), [(0, 3..CHUNK)]);
        assert_eq!(
            parts(CHUNK - 1..2 * CHUNK + 2).collect::<Vec<_>>(),
            [(0, CHUNK - 1..CHUNK), (1, 0..CHUNK), (2, 0..2)]
        );
    }
}
