//! The draws of a frame: one record and one indirect command each, in buffers that the device reads in place.
//!
//! A record is an instance's vertex attributes. Each draw is one instance, whose number (its first instance)
//! selects the record.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use rayon::prelude::*;
use trimaran_cull::{Facing, Solids, View};
use trimaran_proto::DrawableId;

use crate::draw_record::{DrawCommand, DrawRecord, Fetch};
use crate::memory::HostBuffer;
use crate::place::Place;
use crate::recorder::Recorder;
use crate::scene::in_view;
use crate::{Gpu, GpuError, GpuScene};

/// The draws of one frame, in the order given. Submitted ones stay unchanged until [`clear`](Self::clear).
pub(crate) struct Draws {
    gpu: Arc<Gpu>,
    fetch: Fetch,
    chunks: Vec<Chunk>,
    /// Where a submission ends because it has enough work, although there are more draws.
    ends: VecDeque<usize>,
    /// Indices since the last of these ends.
    indices: u64,
    /// Draws since the frame began, and how many of them were recorded.
    added: usize,
    recorded: usize,
    /// Of each draw since the frame began.
    facings: Vec<Facing>,
}

/// Draws per indirect call: far below the 65 thousand commands that every device takes in one.
const CHUNK: usize = 16_384;

/// The indices of a submission before the next one begins: 8 million triangles. So the device's time for one
/// submission does not grow with the scene.
const SUBMISSION: u64 = 3 << 23;

/// The least number of draws for a thread: some tens of microseconds' work.
const MIN_DRAWS: usize = 256;

struct Chunk {
    records: HostBuffer<DrawRecord>,
    commands: HostBuffer<DrawCommand>,
}

impl Draws {
    /// No draws yet.
    pub(crate) const fn new(gpu: Arc<Gpu>, fetch: Fetch) -> Self {
        Self {
            gpu,
            fetch,
            chunks: Vec::new(),
            ends: VecDeque::new(),
            indices: 0,
            added: 0,
            recorded: 0,
            facings: Vec::new(),
        }
    }

    /// Removes all draws. The caller has waited for the device to finish them.
    pub(crate) fn clear(&mut self) {
        (self.added, self.recorded, self.indices) = (0, 0, 0);
        self.ends.clear();
        self.facings.clear();
    }

    /// Whether there are draws that were not recorded.
    pub(crate) const fn has_news(&self) -> bool {
        self.recorded < self.added
    }

    /// Adds one draw for each of `ids` with a place, in `view`; with `opaque`, solids show only their front.
    /// An id that the scene lacks is an error, and none of the ids after it is added.
    pub(crate) fn add(
        &mut self,
        scene: &GpuScene,
        view: &View,
        opaque: bool,
        ids: &[DrawableId],
        places: &[Option<Place>],
    ) -> Result<(), GpuError> {
        let solids = opaque.then(|| Solids::new(view));
        let placed: Vec<_> =
            ids.iter().zip(places).filter_map(|(id, place)| Some((*id, (*place)?))).collect();
        let mut rest = placed.as_slice();
        while !rest.is_empty() {
            let (fetch, added, slot) = (self.fetch, self.added, self.added % CHUNK);
            let (now, later) = rest.split_at(rest.len().min(CHUNK - slot));
            let chunk = self.chunk(added / CHUNK)?;
            let (Some(records), Some(commands)) =
                (chunk.records.elements_mut().get_mut(slot..), chunk.commands.elements_mut().get_mut(slot..))
            else {
                return Ok(()); // a chunk has CHUNK of both
            };
            let slots = records.par_iter_mut().zip(commands);
            let draws = slots.zip(now).enumerate().with_min_len(MIN_DRAWS);
            let draws = draws.map(|(index, ((record, command), (id, place)))| {
                let (drawable, part) = scene.find(*id)?;
                let first = [place.first_index, place.first_vertex];
                *record = DrawRecord { to_view: in_view(&part, view), id: id.0, first };
                *command = DrawCommand::new(fetch, drawable, *place, (slot + index) as u32);
                let facing = solids.as_ref().map_or(Facing::Both, |solids| solids.facing(drawable, &part));
                Ok((facing, 3 * u64::from(drawable.triangles)))
            });
            for (facing, indices) in draws.collect::<Result<Vec<_>, GpuError>>()? {
                self.added += 1;
                self.facings.push(facing);
                self.indices += indices;
                if self.indices >= SUBMISSION {
                    self.ends.push_back(self.added);
                    self.indices = 0;
                }
            }
            rest = later;
        }
        Ok(())
    }

    /// Records the draws added since the last call, or as many as fit one submission: one indirect call for
    /// each run of draws in a chunk with the same visible sides.
    pub(crate) fn record(&mut self, commands: &Recorder<'_>) {
        let end = self.ends.pop_front().unwrap_or(self.added);
        let mut facings = self.facings.get(self.recorded..end).unwrap_or_default();
        for (chunk, part) in parts(self.recorded..end) {
            let (own, later) = facings.split_at(part.len().min(facings.len()));
            facings = later;
            let Some(chunk) = self.chunks.get(chunk) else { continue };
            commands.bind_instances(chunk.records.buffer());
            let mut first = part.start;
            for run in own.chunk_by(|a, b| a == b) {
                run.first().into_iter().for_each(|&facing| commands.face(facing));
                commands.draw_indirect(self.fetch, chunk.commands.buffer(), first..first + run.len());
                first += run.len();
            }
        }
        self.recorded = end;
    }

    /// The chunk of this index, which exists or is made next.
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
