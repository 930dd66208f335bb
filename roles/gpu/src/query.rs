//! Testing boxes by occlusion queries: the paper's method.

use std::{ops::Range, sync::Arc};

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

/// Tests boxes by precise occlusion queries, one per box or one for several, all of a batch before the first
/// is read. Counts pixels.
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
    /// Of each box, whether it is visible without a query.
    certain: Vec<u32>,
    queries: Vec<Query>,
    results: Vec<u32>,
}

/// A query of some boxes, by their records.
struct Query {
    group: usize,
    records: Range<usize>,
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

impl QueryTest<'_> {
    /// Tests several boxes by one query: `sizes` says how many consecutive boxes each query covers. Clears
    /// `visible` and fills it with one entry per query: the pixels at which one of its boxes is visible, each
    /// pixel once a box; 0 if all are hidden.
    ///
    /// # Errors
    /// If the device fails.
    pub fn test_together(
        &mut self,
        view: &View,
        boxes: &[TestBox],
        sizes: impl IntoIterator<Item = usize>,
        visible: &mut Vec<u32>,
    ) -> Result<(), GpuError> {
        let QueryBoxes { records, owners, queries, certain, .. } = &mut *self.boxes;
        boxes::prepare(view, boxes, certain, records, owners);
        queries.clear();
        visible.clear();
        let (mut first_box, mut first_record) = (0, 0);
        for size in sizes {
            let last_box = first_box + size;
            let of = owners.get(first_record..).unwrap_or_default();
            let last_record =
                first_record + of.iter().take_while(|owner| (**owner as usize) < last_box).count();
            // A box that no query can decide is visible, and with it all that are tested together with it.
            let decided = last_record - first_record == size;
            if decided && size > 0 {
                queries.push(Query { group: visible.len(), records: first_record..last_record });
            }
            visible.push(u32::from(!decided));
            (first_box, first_record) = (last_box, last_record);
        }
        self.count(view, visible)
    }

    /// Counts the pixels of all queries.
    fn count(&mut self, view: &View, visible: &mut [u32]) -> Result<(), GpuError> {
        let Self { pass, boxes: QueryBoxes { pipeline, room, records, queries, results, .. } } = self;
        let constants = ProjectionConstants::new(view);
        let mut left = queries.as_slice();
        while let Some(first) = left.first().map(|query| query.records.start) {
            let fits = |query: &&Query| query.records.end - first <= boxes::BATCH;
            let (batch, rest) = left.split_at(left.iter().take_while(fits).count().max(1));
            left = rest;
            let records = records.get(first..batch.last().map_or(first, |query| query.records.end));
            let records = records.unwrap_or_default();
            let make = || Room::new(pass.gpu(), boxes::room_for(records.len()));
            let room = reuse_or_make(room, |room| room.records.len() >= records.len(), make)?;
            let OverDepth { stream, size, depth, .. } = pass.over_depth()?;
            room.records.elements_mut()[..records.len()].copy_from_slice(records);
            stream.submit(OPERATION, Some(Pass::Culling), |commands| {
                commands.reset_queries(room.pool, batch.len() as u32);
                for (in_pass, queries) in batch.chunks(QUERIES_PER_PASS).enumerate() {
                    commands.render(OverDepth::targets(depth, size), || {
                        commands.bind(pipeline, &constants);
                        commands.bind_instances(room.records.buffer());
                        for (index, query) in (in_pass * QUERIES_PER_PASS..).zip(queries) {
                            let [start, end] = [query.records.start, query.records.end];
                            commands.query(room.pool, index as u32, || {
                                commands.draw(boxes::VERTICES, (start - first) as u32..(end - first) as u32);
                            });
                        }
                    });
                }
            })?;
            stream.wait(OPERATION)?;
            room.read(batch.len(), results)?;
            for (&count, query) in results.iter().zip(batch) {
                if let Some(visible) = visible.get_mut(query.group) {
                    *visible = count;
                }
            }
        }
        Ok(())
    }
}

impl OcclusionTest for QueryTest<'_> {
    type Error = GpuError;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), GpuError> {
        self.test_together(view, boxes, std::iter::repeat_n(1, boxes.len()), visible)
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
        Ok(Self {
            pipeline,
            room: None,
            records: vec![],
            owners: vec![],
            certain: vec![],
            queries: vec![],
            results: vec![],
        })
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
