//! Testing boxes on the device against its pyramid of farthest depths.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use rayon::prelude::*;
use trimaran_cull::{
    CutRule, OcclusionTest, OnScreen, Outline, ScreenRecord, ScreenRecords, TestBox, View, WholeTraversal,
};
use trimaran_proto::DrawableId;

use crate::boxes;
use crate::layout::{BindingSet, Layout};
use crate::memory::HostBuffer;
use crate::pass::{OverDepth, ScenePass};
use crate::pipeline::{Pipeline, shader};
use crate::pyramid::{Constants, Halving, Pyramid};
use crate::reuse::reuse_or_make;
use crate::scope;
use crate::timing::Pass;
use crate::traversal::{DeviceTraversal, PyramidDepth};
use crate::{Gpu, GpuError, GpuScene, Optional};

/// Tests boxes by compute shaders against a depth pyramid that stays on the device, with the answers of
/// [`HzbTest`](trimaran_cull::HzbTest).
///
/// Vulkan does not guarantee IEEE 754 rounding of f64, though devices have it. On one without it, an answer
/// might differ from the host's, but no visible box would be hidden: the margins are far larger.
pub struct DeviceHzbTest<'a> {
    pass: &'a mut ScenePass,
    boxes: &'a mut HzbBoxes,
}

const OPERATION: &str = "testing boxes against the depth pyramid";

/// Resources of the test, kept from frame to frame.
pub(crate) struct HzbBoxes {
    halving: Halving,
    layout: Arc<Layout>,
    pipeline: Pipeline,
    /// Both bind the pyramid, so they are dropped before it.
    traversal: Traversal,
    room: Option<Room>,
    pyramid: Option<Pyramid>,
    /// The version of the depth that the pyramid is of.
    pyramid_of: Option<u64>,
    found: Vec<OnScreen>,
    records: Vec<ScreenRecord>,
    owners: Vec<u32>,
}

/// Traversals on the device.
#[derive(Default)]
enum Traversal {
    #[default]
    Untried,
    /// The device cannot, or not as the host does.
    Impossible,
    Ready(Box<DeviceTraversal>),
}

impl Traversal {
    fn get(&mut self, scene: &GpuScene) -> Result<Option<&mut DeviceTraversal>, GpuError> {
        if matches!(self, Self::Untried) {
            let made = match DeviceTraversal::new(scene) {
                Err(GpuError::Allocation { what, bytes, .. }) => {
                    tracing::warn!(what, bytes, "the host traverses: the device has no room for the tree");
                    None
                }
                made => made?.or_else(|| {
                    tracing::warn!(
                        "the host traverses: the device rounds f64 differently or binds too few buffers"
                    );
                    None
                }),
            };
            *self = made.map_or(Self::Impossible, |traversal| Self::Ready(Box::new(traversal)));
        }
        Ok(if let Self::Ready(traversal) = self { Some(traversal) } else { None })
    }
}

/// Resources for a batch of this many boxes.
struct Room {
    set: BindingSet,
    records: HostBuffer<ScreenRecord>,
    answers: HostBuffer<u32>,
}

/// The least number of boxes per thread: a tenth of a millisecond's work.
const MIN_BOXES: usize = 512;

impl<'a> DeviceHzbTest<'a> {
    pub(crate) fn new(pass: &'a mut ScenePass, kept: &'a mut Option<HzbBoxes>) -> Result<Self, GpuError> {
        let boxes = reuse_or_make(kept, |_| true, || HzbBoxes::new(pass.gpu()))?;
        Ok(Self { pass, boxes })
    }

    /// Maps drawables of an earlier frame's cut to their counterparts in this one's, in any order, as
    /// [`OccluderMapper`](trimaran_cull::OccluderMapper) does. `None` if the device cannot, or not so many.
    ///
    /// # Errors
    /// If the device fails, or part of the scene cannot be read.
    pub fn map(
        &mut self,
        view: &View,
        rule: &CutRule,
        ids: &[DrawableId],
    ) -> Result<Option<Vec<DrawableId>>, GpuError> {
        let Self { pass, boxes: own } = self;
        let ready = own.fit(pass, view)?;
        let scene = Arc::clone(pass.scene());
        let HzbBoxes { halving, pyramid, traversal, .. } = own;
        let (Some(pyramid), Some(traversal)) = (pyramid, traversal.get(&scene)?) else { return Ok(None) };
        let constants = pyramid.constants(ready.margins());
        let over = pass.unfinished_depth();
        let mut depth = PyramidDepth { over, pyramid, halving, is_built: false, constants };
        traversal.map(&mut depth, &scene, view, rule, ids)
    }
}

#[cfg(test)]
impl DeviceHzbTest<'_> {
    /// The traversal of the pass's scene.
    pub(crate) fn traversal(&mut self) -> &mut DeviceTraversal {
        self.boxes.traversal.get(self.pass.scene()).unwrap().unwrap()
    }
}

impl OcclusionTest for DeviceHzbTest<'_> {
    type Error = GpuError;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), GpuError> {
        let Self { pass, boxes: own } = self;
        let ready = own.fit(pass, view)?;
        own.prepare(&ready, boxes, visible);
        let HzbBoxes { halving, layout, pipeline, room, pyramid, pyramid_of, records, owners, .. } = own;
        let Some(pyramid) = pyramid else { return Ok(()) };
        let constants = pyramid.constants(ready.margins());
        for (records, owners) in boxes::batches(records, owners) {
            let make = || Room::new(pass.gpu(), layout, pyramid, boxes::room_for(records.len()));
            let room = reuse_or_make(room, |room| room.records.len() >= records.len(), make)?;
            let OverDepth { stream, depth, version, .. } = pass.over_depth()?;
            room.records.elements_mut()[..records.len()].copy_from_slice(records);
            let is_built = *pyramid_of == Some(version);
            let pass = if is_built { Pass::Culling } else { Pass::Pyramid };
            stream.submit(OPERATION, Some(pass), |commands| {
                if !is_built {
                    pyramid.build(commands, halving, depth);
                }
                commands.bind(pipeline, &constants);
                commands.bind_set(pipeline, &room.set);
                commands.dispatch([records.len() as u32, 1]);
                commands.barrier(scope::COMPUTE_WRITE, scope::HOST_READ);
            })?;
            stream.wait(OPERATION)?;
            *pyramid_of = Some(version);
            boxes::hand_out(room.answers.elements(), owners, visible);
        }
        Ok(())
    }

    fn traverse(&mut self, view: &View, rule: &CutRule) -> Result<Option<WholeTraversal>, GpuError> {
        let Self { pass, boxes: own } = self;
        let ready = own.fit(pass, view)?;
        let scene = Arc::clone(pass.scene());
        let HzbBoxes { halving, pyramid, pyramid_of, traversal, .. } = own;
        let (Some(pyramid), Some(traversal)) = (pyramid, traversal.get(&scene)?) else { return Ok(None) };
        let constants = pyramid.constants(ready.margins());
        let over = pass.over_depth()?;
        let version = Some(over.version);
        let is_built = *pyramid_of == version;
        let mut depth = PyramidDepth { over, pyramid, halving, is_built, constants };
        let found = traversal.traverse(&mut depth, &scene, view, rule)?;
        *pyramid_of = version;
        Ok(found)
    }

    fn outline(&self) -> Outline {
        Outline::OnScreen
    }
}

impl HzbBoxes {
    fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        if gpu.info().lacks.contains(&Optional::Float64) {
            let device = gpu.info().name.clone();
            return Err(GpuError::Unsuitable { device, missing: Optional::Float64.name().to_owned() });
        }
        let layout = Layout::new::<Constants>(gpu, 3)?;
        let pipeline = Pipeline::compute(&layout, shader!("cs_test_boxes"))?;
        Ok(Self {
            halving: Halving::new(gpu)?,
            layout,
            pipeline,
            room: None,
            pyramid: None,
            pyramid_of: None,
            found: vec![],
            records: vec![],
            owners: vec![],
            traversal: Traversal::default(),
        })
    }

    /// Makes room for a pyramid over the pass's depth, and what boxes of the view are prepared with.
    fn fit(&mut self, pass: &ScenePass, view: &View) -> Result<ScreenRecords, GpuError> {
        let Self { halving, room, pyramid, pyramid_of, traversal, .. } = self;
        let size = pass.size();
        if view.viewport() != size {
            return Err(GpuError::OtherSize { view: view.viewport(), depth: size });
        }
        if pyramid.as_ref().is_none_or(|pyramid| pyramid.size() != size) {
            (*room, *pyramid_of) = (None, None);
            if let Traversal::Ready(traversal) = traversal {
                traversal.forget_pyramid();
            }
        }
        let make = || Pyramid::new(pass.gpu(), halving, size);
        reuse_or_make(pyramid, |pyramid| pyramid.size() == size, make)?;
        Ok(ScreenRecords::new(view, Outline::OnScreen))
    }

    /// Prepares a batch: a record for each box that depends on the depth, with its index.
    fn prepare(&mut self, ready: &ScreenRecords, boxes: &[TestBox], visible: &mut Vec<u32>) {
        visible.clear();
        self.records.clear();
        self.owners.clear();
        boxes
            .par_iter()
            .with_min_len(MIN_BOXES)
            .map(|test_box| ready.find(test_box))
            .collect_into_vec(&mut self.found);
        for (index, found) in (0..).zip(self.found.drain(..)) {
            visible.push(u32::from(matches!(found, OnScreen::Shows)));
            if let OnScreen::Test(record) = found {
                self.records.push(record);
                self.owners.push(index);
            }
        }
    }
}

impl Room {
    fn new(gpu: &Arc<Gpu>, layout: &Arc<Layout>, pyramid: &Pyramid, boxes: usize) -> Result<Self, GpuError> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let records = HostBuffer::new(gpu, "boxes to test", usage, MemoryLocation::CpuToGpu, boxes)?;
        let answers = HostBuffer::new(gpu, "answers for boxes", usage, MemoryLocation::GpuToCpu, boxes)?;
        let set = BindingSet::new(layout, &[pyramid.texels(), records.buffer(), answers.buffer()])?;
        Ok(Self { set, records, answers })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::shader;
    use crate::pipeline::Shader;

    /// Words of a module after its header, by instruction.
    fn instructions(words: &[u32]) -> impl Iterator<Item = &[u32]> {
        let mut rest = &words[5..];
        std::iter::from_fn(move || {
            let (first, later) = rest.split_at_checked((rest.first()? >> 16) as usize)?;
            rest = later;
            Some(first)
        })
    }

    /// CPU drivers do not contract, so only the module shows it.
    #[test]
    fn no_sum_or_product_of_the_test_may_be_contracted() {
        assert_not_contracted(shader!("cs_test_boxes"), 16);
    }

    /// Passes must agree on sections to the last bit.
    #[test]
    fn no_sum_or_product_that_sections_hang_on_may_be_contracted() {
        for shader in [
            shader!("fs_depth_cut"),
            shader!("fs_picture_cut"),
            shader!("fs_item_cut"),
            shader!("fs_item_pulled_cut"),
        ] {
            assert_not_contracted(shader, 12);
        }
    }

    fn assert_not_contracted(shader: Shader, least: usize) {
        let words: Vec<u32> =
            shader.spirv.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        let (mut arithmetic, mut decorated) = (BTreeSet::new(), BTreeSet::new());
        for instruction in instructions(&words) {
            match (instruction[0] & 0xffff, instruction) {
                (129 | 131 | 133, [_, _, result, ..]) => _ = arithmetic.insert(*result),
                (71, [_, target, 42]) => _ = decorated.insert(*target),
                _ => {}
            }
        }
        let entry = shader.entry;
        assert!(arithmetic.len() >= least, "{entry:?}: {} sums and products", arithmetic.len());
        assert_eq!(arithmetic, decorated, "{entry:?}");
    }
}
