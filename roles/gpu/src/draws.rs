//! The draws of a frame: one record and one indirect command each, in buffers that the device reads in place.

use std::ops::Range;
use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::View;
use trimaran_proto::DrawableId;

use crate::memory::HostBuffer;
use crate::pipeline::{BindingSet, Layout, Pipeline};
use crate::recorder::Recorder;
use crate::{Gpu, GpuError, GpuScene};

/// The draws of one frame, in the order given. Those already submitted stay as they are until [`clear`](Self::clear).
pub(crate) struct Draws {
    gpu: Arc<Gpu>,
    layout: Arc<Layout>,
    chunks: Vec<Chunk>,
    /// Draws since the frame began, and how many of them were recorded.
    added: usize,
    recorded: usize,
}

/// Draws that share an indirect call. So few that no device's limits are near: a megabyte of storage buffer, of 128; 16 thousand commands, of
/// 65 thousand.
const CHUNK: usize = 16_384;

struct Chunk {
    // The set before the buffers it binds, so that it goes first.
    set: BindingSet,
    records: HostBuffer<DrawRecord>,
    commands: HostBuffer<DrawCommand>,
}

/// `Draw` of scene.wgsl.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct DrawRecord {
    to_view: [[f32; 4]; 3],
    id: [u32; 4],
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
    /// No draws yet. `layout` has one storage buffer, for the records.
    pub(crate) const fn new(gpu: Arc<Gpu>, layout: Arc<Layout>) -> Self {
        Self { gpu, layout, chunks: Vec::new(), added: 0, recorded: 0 }
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
            let mut first_instance = slot as u32;
            for ((record, command), &id) in records.iter_mut().zip(commands).zip(now) {
                let (range, place) = scene.find(id)?;
                *record = DrawRecord { to_view: place.to_view(view), id: [id.0, 0, 0, 0] };
                *command = DrawCommand {
                    index_count: range.index_count,
                    instance_count: 1,
                    first_index: range.first_index,
                    vertex_offset: range.vertex_offset,
                    first_instance,
                };
                first_instance += 1;
            }
            self.added += now.len();
            rest = later;
        }
        Ok(())
    }

    /// Records the draws added since the last time: one indirect call a chunk.
    pub(crate) fn record(&mut self, commands: &Recorder<'_>, pipeline: &Pipeline) {
        for (chunk, part) in parts(self.recorded..self.added) {
            if let Some(chunk) = self.chunks.get(chunk) {
                commands.bind_set(pipeline, &chunk.set);
                commands.draw_indexed_indirect(chunk.commands.buffer(), part.start, part.len());
            }
        }
        self.recorded = self.added;
    }

    /// The chunk of this index, which exists or is the next one to make.
    fn chunk(&mut self, index: usize) -> Result<&mut Chunk, GpuError> {
        if index >= self.chunks.len() {
            self.chunks.push(Chunk::new(&self.gpu, &self.layout)?);
        }
        let last = self.chunks.len() - 1;
        Ok(&mut self.chunks[index.min(last)])
    }
}

impl Chunk {
    fn new(gpu: &Arc<Gpu>, layout: &Arc<Layout>) -> Result<Self, GpuError> {
        let here = MemoryLocation::CpuToGpu;
        let records =
            HostBuffer::new(gpu, "draw records", vk::BufferUsageFlags::STORAGE_BUFFER, here, CHUNK)?;
        let commands =
            HostBuffer::new(gpu, "draw commands", vk::BufferUsageFlags::INDIRECT_BUFFER, here, CHUNK)?;
        let set = BindingSet::new(layout, &[records.buffer()])?;
        Ok(Self { set, records, commands })
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
