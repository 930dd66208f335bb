//! Testing boxes by occlusion queries: the paper's method.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::{Answer, OcclusionTest, TestBox, View};

use crate::boxes::{self, BoxRecord};
use crate::camera::ProjectionConstants;
use crate::error::During as _;
use crate::layout::Layout;
use crate::memory::HostBuffer;
use crate::pass::{OverDepth, ScenePass};
use crate::pipeline::{DepthUse, Pipeline, PipelineDesc, VertexInput, shader};
use crate::reuse::reuse_or_make;
use crate::timing::Pass;
use crate::{Gpu, GpuError};

/// Tests boxes by precise occlusion queries, one per box, all of a batch before the first is read. Counts
/// pixels.
pub struct QueryTest<'a> {
    pass: &'a mut ScenePass,
    boxes: &'a mut QueryBoxes,
}

/// The most queries per render pass: beyond that Mesa 25.0 miscounts one query in some 3,990.
const QUERIES_PER_PASS: usize = 1000;

const OPERATION: &str = "testing boxes by occlusion queries";

/// Resources of queries, kept from frame to frame.
pub(crate) struct QueryBoxes {
    pipeline: Pipeline,
    room: Option<Room>,
    records: Vec<BoxRecord>,
    owners: Vec<u32>,
    results: Vec<u32>,
}

/// Resources for a batch of this many boxes.
struct Room {
    gpu: Arc<Gpu>,
    pool: vk::QueryPool,
    records: HostBuffer<BoxRecord>,
}

impl<'a> QueryTest<'a> {
    pub(crate) fn new(pass: &'a mut ScenePass, kept: &'a mut Option<QueryBoxes>) -> Result<Self, GpuError> {
        let boxes = reuse_or_make(kept, |_| true, || QueryBoxes::new(pass.gpu()))?;
        Ok(Self { pass, boxes })
    }
}

impl OcclusionTest for QueryTest<'_> {
    type Error = GpuError;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), GpuError> {
        let Self { pass, boxes: QueryBoxes { pipeline, room, records, owners, results } } = self;
        boxes::prepare(view, boxes, visible, records, owners);
        let constants = ProjectionConstants::new(view);
        for (records, owners) in boxes::batches(records, owners) {
            let make = || Room::new(pass.gpu(), boxes::room_for(records.len()));
            let room = reuse_or_make(room, |room| room.records.len() >= records.len(), make)?;
            let OverDepth { stream, size, depth, .. } = pass.over_depth()?;
            room.records.elements_mut()[..records.len()].copy_from_slice(records);
            stream.submit(OPERATION, Some(Pass::Culling), |commands| {
                commands.reset_queries(room.pool, records.len() as u32);
                for first in (0..records.len()).step_by(QUERIES_PER_PASS) {
                    let last = records.len().min(first + QUERIES_PER_PASS);
                    commands.render(OverDepth::targets(depth, size), || {
                        commands.bind(pipeline, &constants);
                        commands.bind_instances(room.records.buffer());
                        for index in first as u32..last as u32 {
                            commands.query(room.pool, index, || {
                                commands.draw(boxes::VERTICES, index..index + 1);
                            });
                        }
                    });
                }
            })?;
            stream.wait(OPERATION)?;
            room.read(records.len(), results)?;
            boxes::hand_out(results, owners, visible);
        }
        Ok(())
    }

    fn answer(&self) -> Answer {
        Answer::PixelCount
    }
}

impl QueryBoxes {
    fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let layout = Layout::new::<ProjectionConstants>(gpu, 0)?;
        let pipeline = Pipeline::new(
            &layout,
            &PipelineDesc {
                vertex: shader!("vs_box"),
                fragment: None,
                input: VertexInput::Box,
                colour: None,
                depth: DepthUse::Test,
            },
        )?;
        Ok(Self { pipeline, room: None, records: vec![], owners: vec![], results: vec![] })
    }
}

impl Room {
    fn new(gpu: &Arc<Gpu>, boxes: usize) -> Result<Self, GpuError> {
        let records = HostBuffer::new(
            gpu,
            "boxes to test",
            vk::BufferUsageFlags::VERTEX_BUFFER,
            MemoryLocation::CpuToGpu,
            boxes,
        )?;
        let info =
            vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::OCCLUSION).query_count(boxes as u32);
        // SAFETY: the device is alive and the count is above 0.
        let pool =
            unsafe { gpu.device().create_query_pool(&info, None) }.during("making occlusion queries")?;
        Ok(Self { gpu: Arc::clone(gpu), pool, records })
    }

    /// The counts of the first `count` queries, whose work is done.
    fn read(&self, count: usize, results: &mut Vec<u32>) -> Result<(), GpuError> {
        results.clear();
        results.resize(count, 0);
        // Without WAIT, which has no timeout: the stream has waited.
        let flags = vk::QueryResultFlags::empty();
        // SAFETY: these queries lie in the pool and have ended; the slice has one element for each, of the
        // type asked for.
        unsafe { self.gpu.device().get_query_pool_results(self.pool, 0, results, flags) }.during(OPERATION)
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        let Some(device) = self.gpu.to_destroy() else { return };
        // SAFETY: ours, and each test waits for its queries (or the pass's stream did, dropped before).
        unsafe { device.destroy_query_pool(self.pool, None) };
    }
}
