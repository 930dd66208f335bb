//! Testing boxes by counting the fragments that pass the depth test.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::{Answer, OcclusionTest, TestBox, View};

use crate::boxes::{self, BoxRecord};
use crate::camera::ProjectionConstants;
use crate::layout::{BindingSet, Layout};
use crate::memory::{Buffer, HostBuffer};
use crate::pass::{OverDepth, ScenePass};
use crate::pipeline::{DepthUse, Pipeline, PipelineDesc, VertexInput, shader};
use crate::reuse::reuse_or_make;
use crate::scope;
use crate::timing::Pass;
use crate::{Gpu, GpuError};

/// Tests boxes by one instanced draw of a whole batch: a fragment that passes the early depth test adds one
/// to its box's count. The counts are those of [`QueryTest`](crate::QueryTest), at a fraction of the cost
/// while boxes are small.
pub struct RasterTest<'a> {
    pass: &'a mut ScenePass,
    boxes: &'a mut RasterBoxes,
}

const OPERATION: &str = "testing boxes by counting fragments";

/// Resources for counting, kept from frame to frame.
pub(crate) struct RasterBoxes {
    layout: Arc<Layout>,
    pipeline: Pipeline,
    room: Option<Room>,
    records: Vec<BoxRecord>,
    owners: Vec<u32>,
}

/// Resources for a batch of this many boxes.
struct Room {
    set: BindingSet,
    records: HostBuffer<BoxRecord>,
    /// The device's counters: in its own memory, since atomics across a bus are slow.
    counts: Buffer,
    /// The host's copy.
    results: HostBuffer<u32>,
}

impl<'a> RasterTest<'a> {
    pub(crate) fn new(pass: &'a mut ScenePass, kept: &'a mut Option<RasterBoxes>) -> Result<Self, GpuError> {
        let boxes = reuse_or_make(kept, |_| true, || RasterBoxes::new(pass.gpu()))?;
        Ok(Self { pass, boxes })
    }
}

impl OcclusionTest for RasterTest<'_> {
    type Error = GpuError;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), GpuError> {
        let Self { pass, boxes: RasterBoxes { layout, pipeline, room, records, owners } } = self;
        boxes::prepare(view, boxes, visible, records, owners);
        let constants = ProjectionConstants::new(view);
        let count = (
            vk::PipelineStageFlags2::FRAGMENT_SHADER,
            vk::AccessFlags2::SHADER_STORAGE_READ | vk::AccessFlags2::SHADER_STORAGE_WRITE,
        );
        for (records, owners) in boxes::batches(records, owners) {
            let make = || Room::new(pass.gpu(), layout, boxes::room_for(records.len()));
            let room = reuse_or_make(room, |room| room.records.len() >= records.len(), make)?;
            let OverDepth { stream, size, depth, .. } = pass.over_depth()?;
            room.records.elements_mut()[..records.len()].copy_from_slice(records);
            stream.submit(OPERATION, Some(Pass::Culling), |commands| {
                commands.fill(&room.counts, 0);
                commands.barrier(scope::FILL, count);
                commands.render(OverDepth::targets(depth, size), || {
                    commands.bind(pipeline, &constants);
                    commands.bind_set(pipeline, &room.set);
                    commands.bind_instances(room.records.buffer());
                    commands.draw(boxes::VERTICES, 0..records.len() as u32);
                });
                commands.barrier(count, scope::COPY_READ);
                let bytes = size_of_val(owners) as u64;
                let all = vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes };
                commands.copy(&room.counts, room.results.buffer(), &[all]);
                commands.barrier(scope::COPY_WRITE, scope::HOST_READ);
            })?;
            stream.wait(OPERATION)?;
            boxes::hand_out(room.results.elements(), owners, visible);
        }
        Ok(())
    }

    fn answer(&self) -> Answer {
        Answer::PixelCount
    }
}

impl RasterBoxes {
    fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let layout = Layout::new::<ProjectionConstants>(gpu, 1)?;
        let pipeline = Pipeline::new(
            &layout,
            &PipelineDesc {
                vertex: shader!("vs_counted_box"),
                fragment: Some(shader!("fs_count")),
                input: VertexInput::Box,
                colour: None,
                depth: DepthUse::Test,
            },
        )?;
        Ok(Self { layout, pipeline, room: None, records: vec![], owners: vec![] })
    }
}

impl Room {
    fn new(gpu: &Arc<Gpu>, layout: &Arc<Layout>, boxes: usize) -> Result<Self, GpuError> {
        use vk::BufferUsageFlags as Usage;
        let records =
            HostBuffer::new(gpu, "boxes to test", Usage::VERTEX_BUFFER, MemoryLocation::CpuToGpu, boxes)?;
        let counts = Buffer::new(
            gpu,
            "counts of boxes",
            Usage::STORAGE_BUFFER | Usage::TRANSFER_DST | Usage::TRANSFER_SRC,
            MemoryLocation::GpuOnly,
            (boxes * size_of::<u32>()) as u64,
        )?;
        let results = HostBuffer::new(
            gpu,
            "counts of boxes read back",
            Usage::TRANSFER_DST,
            MemoryLocation::GpuToCpu,
            boxes,
        )?;
        let set = BindingSet::new(layout, &[&counts])?;
        Ok(Self { set, records, counts, results })
    }
}
