//! The lists and counters of a traversal on the device.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::{CutRecord, ScreenRecord, StepCounts};

use crate::layout::{BindingSet, Layout};
use crate::memory::{Buffer, HostBuffer};
use crate::tree::Entry;
use crate::{Gpu, GpuError};

/// The most steps of a frame: the tree's depth, and one more for the pieces of the deepest nodes.
pub(crate) const STEPS: usize = 64;

/// Entries that a workgroup prepares.
pub(crate) const PREPARED_AT_ONCE: u32 = 64;

/// The bytes of `Outcome`.
const OUTCOME_BYTES: usize = 20;

/// Lists of one capacity. The set binds them, the pyramid and the scene's tree.
pub(crate) struct Room {
    pub(crate) set: BindingSet,
    pub(crate) capacity: u32,
    pub(crate) cut: HostBuffer<CutRecord>,
    /// The counters and the entries to begin with.
    pub(crate) first: HostBuffer<Counters>,
    pub(crate) first_entries: HostBuffer<Entry>,
    /// The drawables to map.
    pub(crate) mapped: HostBuffer<Entry>,
    pub(crate) entries: Buffer,
    #[expect(dead_code, reason = "held")]
    boxes: Buffer,
    #[expect(dead_code, reason = "held")]
    outcomes: Buffer,
    pub(crate) counters: Buffer,
    /// The counters at the end.
    pub(crate) counted: HostBuffer<Counters>,
    pub(crate) visible: HostBuffer<u32>,
    pub(crate) missing: HostBuffer<Entry>,
}

/// The workgroups of a dispatch.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Groups([u32; 3]);

#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Dispatches {
    pub(crate) prepare: Groups,
    pub(crate) test: Groups,
    pub(crate) entries: u32,
    pub(crate) boxes: u32,
}

impl Dispatches {
    const NONE: Self = Self { prepare: Groups([0, 1, 1]), test: Groups([0, 1, 1]), entries: 0, boxes: 0 };
}

#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Counters {
    pub(crate) visible: u32,
    pub(crate) missing: u32,
    pub(crate) overflow: u32,
    pub(crate) dispatches: [Dispatches; STEPS + 1],
    pub(crate) steps: [StepCounts; STEPS],
}

impl Counters {
    /// The same before a submission that begins with this many entries.
    pub(crate) fn with_first(self, entries: u32) -> Self {
        let mut dispatches = [Dispatches::NONE; STEPS + 1];
        dispatches[0] = Dispatches {
            prepare: Groups([entries.div_ceil(PREPARED_AT_ONCE), 1, 1]),
            entries,
            ..Dispatches::NONE
        };
        Self { missing: 0, overflow: 0, dispatches, ..self }
    }

    /// The counters of the steps that visited anything.
    pub(crate) fn used_steps(&self) -> &[StepCounts] {
        let used = self.steps.iter().rposition(|step| step.visited > 0).map_or(0, |last| last + 1);
        self.steps.get(..used).unwrap_or_default()
    }
}

impl Room {
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        layout: &Arc<Layout>,
        bound: [&Buffer; 6],
        capacity: u32,
    ) -> Result<Self, GpuError> {
        use vk::BufferUsageFlags as Usage;
        const LISTS: &str = "lists of a traversal";
        let count = capacity as usize;
        let list = |usage: Usage, bytes: usize| {
            Buffer::new(gpu, LISTS, Usage::STORAGE_BUFFER | usage, MemoryLocation::GpuOnly, bytes as u64)
        };
        let entries = list(Usage::TRANSFER_DST, 2 * count * size_of::<Entry>())?;
        let boxes = list(Usage::empty(), count * size_of::<ScreenRecord>())?;
        let outcomes = list(Usage::empty(), count * OUTCOME_BYTES)?;
        let counted = Usage::TRANSFER_SRC | Usage::TRANSFER_DST | Usage::INDIRECT_BUFFER;
        let counters = list(counted, size_of::<Counters>())?;
        let cut = HostBuffer::new(gpu, LISTS, Usage::STORAGE_BUFFER, MemoryLocation::CpuToGpu, 1)?;
        let visible = HostBuffer::new(gpu, LISTS, Usage::STORAGE_BUFFER, MemoryLocation::GpuToCpu, count)?;
        let missing = HostBuffer::new(gpu, LISTS, Usage::STORAGE_BUFFER, MemoryLocation::GpuToCpu, count)?;
        let [texels, pages, nodes, drawables, appearances, stamps] = bound;
        let buffers = [
            texels,
            &boxes,
            cut.buffer(),
            pages,
            nodes,
            drawables,
            &entries,
            &outcomes,
            visible.buffer(),
            &counters,
            missing.buffer(),
            appearances,
            stamps,
        ];
        Ok(Self {
            set: BindingSet::new(layout, &buffers)?,
            capacity,
            first: HostBuffer::new(gpu, LISTS, Usage::TRANSFER_SRC, MemoryLocation::CpuToGpu, 1)?,
            first_entries: HostBuffer::new(gpu, LISTS, Usage::TRANSFER_SRC, MemoryLocation::CpuToGpu, count)?,
            mapped: HostBuffer::new(gpu, LISTS, Usage::TRANSFER_SRC, MemoryLocation::CpuToGpu, count)?,
            counted: HostBuffer::new(gpu, LISTS, Usage::TRANSFER_DST, MemoryLocation::GpuToCpu, 1)?,
            cut,
            entries,
            boxes,
            outcomes,
            counters,
            visible,
            missing,
        })
    }

    /// The copy of this many entries to where those of the second step will stand.
    pub(crate) const fn second_list(&self, entries: usize) -> vk::BufferCopy {
        let bytes = size_of::<Entry>() as u64;
        vk::BufferCopy {
            src_offset: 0,
            dst_offset: self.capacity as u64 * bytes,
            size: entries as u64 * bytes,
        }
    }
}
