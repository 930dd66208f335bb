//! HC in one submission: the device goes through the tree by itself, from the root to the visible drawables.
//! So it does for OR, from the last frame's drawables to their counterparts in this frame's cut.
//!
//! The host waits once a frame in place of once a level of the tree. Records that the device lacks end a
//! branch: the host brings them, and another submission goes on there. Nothing is left out: a list that
//! overflows is made larger, and the frame is culled anew.

use std::mem::offset_of;
use std::sync::Arc;

use ash::vk;
use bytemuck::Zeroable as _;
use gpu_allocator::MemoryLocation;
use trimaran_cull::{CutRecord, CutRule, View, WholeTraversal};
use trimaran_proto::DrawableId;

use crate::layout::Layout;
use crate::memory::Buffer;
use crate::pass::OverDepth;
use crate::pipeline::{Pipeline, shader};
use crate::pyramid::{Constants, Halving, Pyramid};
use crate::reuse::reuse_or_make;
use crate::scope;
use crate::timing::Pass;
use crate::traversal_lists::{Counters, Dispatches, PREPARED_AT_ONCE, Room, STEPS};
use crate::tree::{Entry, Tree, Upload};
use crate::{GpuError, GpuScene};

/// The pipelines and buffers of one culler.
pub(crate) struct DeviceTraversal {
    layout: Arc<Layout>,
    mark: Pipeline,
    prepare: Pipeline,
    test: Pipeline,
    leave: Pipeline,
    room: Option<Room>,
    upload: Upload,
    /// How many entries each list takes.
    capacity: u32,
    /// How many steps the last frame had: of mapping, and of culling.
    steps: [u32; 2],
    /// Of nodes and of drawables: the mapping in which each was marked.
    stamps: Buffer,
    /// The last mapping's; 0 if nothing is marked on the device.
    stamp: u32,
}

/// A pyramid over a culler's depth, built or to be built.
pub(crate) struct PyramidDepth<'a> {
    pub(crate) over: OverDepth<'a>,
    pub(crate) pyramid: &'a Pyramid,
    pub(crate) halving: &'a Halving,
    pub(crate) is_built: bool,
    pub(crate) constants: Constants,
}

/// The beginning of a submission.
struct Visit<'a> {
    /// The entries to visit.
    from: Vec<Entry>,
    /// Those whose records are brought.
    lacks: Vec<Entry>,
    /// The counters before it.
    counters: Counters,
    /// The drawables to mark before.
    mapped: &'a [DrawableId],
}

impl<'a> Visit<'a> {
    /// Of the whole tree.
    fn anew(mapped: &'a [DrawableId]) -> Self {
        let root = vec![Entry::ROOT];
        Self { from: root.clone(), lacks: root, counters: Counters::zeroed(), mapped }
    }
}

/// The lists of a culler at first, and the most that a dispatch takes: Vulkan promises as many workgroups.
const FIRST_CAPACITY: u32 = 8_191;
const MOST_CAPACITY: u32 = 65_535;

/// Submissions of a frame, most of which bring records, before the host takes over.
const MOST_SUBMISSIONS: usize = 256;

/// The storage buffers that the shaders bind.
const BUFFERS: u32 = 13;

const OPERATION: &str = "traversing the tree on the device";

/// Bits of `Counters::overflow`: a list was too short, and a record was absent while drawables were marked.
const OVERFLOW: u32 = 1;
const UNMARKED: u32 = 2;

/// The last stamp: twice a stamp and one more fits a word.
const LAST_STAMP: u32 = u32::MAX / 2;

impl DeviceTraversal {
    /// `None` if the device cannot do that as the host does.
    pub(crate) fn new(scene: &GpuScene) -> Result<Option<Self>, GpuError> {
        let gpu = scene.gpu();
        let is_able = gpu.limits().max_storage_buffers >= BUFFERS && scene.rounds_as_the_host()?;
        if !(is_able && scene.scene().is_whole()) {
            return Ok(None);
        }
        let layout = Layout::new::<Constants>(gpu, BUFFERS)?;
        let pipeline = |shader| Pipeline::compute(&layout, shader);
        use vk::BufferUsageFlags as Usage;
        let stamps = scene.scene().nodes().len() + scene.scene().drawables().len();
        let (usage, bytes) = (Usage::STORAGE_BUFFER | Usage::TRANSFER_DST, 4 * stamps.max(1) as u64);
        Ok(Some(Self {
            mark: pipeline(shader!("cs_mark"))?,
            prepare: pipeline(shader!("cs_prepare"))?,
            test: pipeline(shader!("cs_test"))?,
            leave: pipeline(shader!("cs_leave"))?,
            layout,
            room: None,
            upload: Upload::new(gpu, &*scene.tree()?)?,
            capacity: FIRST_CAPACITY,
            steps: [16; 2],
            stamps: Buffer::new(gpu, "stamps of the tree", usage, MemoryLocation::GpuOnly, bytes)?,
            stamp: 0,
        }))
    }

    /// The pyramid will be another one. The device is done with it.
    pub(crate) fn forget_pyramid(&mut self) {
        self.room = None;
    }

    /// Traverses the tree of `scene` from `view`. `None` if it is empty, or the longest lists do not suffice.
    pub(crate) fn traverse(
        &mut self,
        depth: &mut PyramidDepth<'_>,
        scene: &GpuScene,
        view: &View,
        rule: &CutRule,
    ) -> Result<Option<WholeTraversal>, GpuError> {
        let Some(counters) = self.go_through(depth, scene, (view, rule), &[])? else { return Ok(None) };
        Ok(Some(WholeTraversal { visible: self.found(&counters), steps: counters.used_steps().to_vec() }))
    }

    /// The counterparts of `ids` in the cut, each once. `None` as for [`traverse`](Self::traverse).
    pub(crate) fn map(
        &mut self,
        depth: &mut PyramidDepth<'_>,
        scene: &GpuScene,
        view: &View,
        rule: &CutRule,
        ids: &[DrawableId],
    ) -> Result<Option<Vec<DrawableId>>, GpuError> {
        let count = scene.scene().drawables().len();
        if ids.is_empty() {
            return Ok(Some(Vec::new()));
        }
        if ids.len() > MOST_CAPACITY as usize || ids.iter().any(|id| id.index() >= count) {
            return Ok(None);
        }
        while (self.capacity as usize) < ids.len() {
            self.capacity = (self.capacity * 4).min(MOST_CAPACITY);
        }
        let counters = self.go_through(depth, scene, (view, rule), ids)?;
        Ok(counters.map(|counters| self.found(&counters)))
    }

    /// The drawables that the last submission has found.
    fn found(&self, counters: &Counters) -> Vec<DrawableId> {
        let found =
            self.room.as_ref().and_then(|room| room.visible.elements().get(..counters.visible as usize));
        found.unwrap_or_default().iter().map(|id| DrawableId(*id)).collect()
    }

    /// Goes through the tree once: maps these drawables, or culls without any.
    fn go_through(
        &mut self,
        depth: &mut PyramidDepth<'_>,
        scene: &GpuScene,
        (view, rule): (&View, &CutRule),
        mapped: &[DrawableId],
    ) -> Result<Option<Counters>, GpuError> {
        if scene.scene().nodes().is_empty() {
            return Ok(None);
        }
        let mut cut = CutRecord::new(scene.scene(), view, rule);
        cut.mapped = mapped.len() as u32;
        let mut at = Visit::anew(mapped);
        let generation = scene.tree()?.generation();
        for _ in 0..MOST_SUBMISSIONS {
            let counters = self.visit(depth, scene, (cut, rule), &at)?;
            let Some(room) = &self.room else { return Ok(None) };
            let lacks = room.missing.elements().get(..counters.missing as usize).unwrap_or_default();
            if counters.overflow & OVERFLOW != 0 {
                if self.capacity == MOST_CAPACITY {
                    return Ok(None);
                }
                self.capacity = (self.capacity * 4).min(MOST_CAPACITY);
                at = Visit::anew(mapped);
            } else if counters.overflow & UNMARKED != 0 {
                at.lacks = lacks.to_vec();
                // The marked nodes do not fit at once, or hardly.
                if scene.tree()?.generation() > generation + 1 {
                    return Ok(None);
                }
            } else if counters.missing == 0 {
                self.steps[usize::from(mapped.is_empty())] = counters.used_steps().len() as u32;
                return Ok(Some(counters));
            } else {
                at = Visit { from: lacks.to_vec(), lacks: lacks.to_vec(), counters, mapped: &[] };
            }
        }
        Ok(None)
    }

    /// Visits these entries and all below them, and counts on.
    fn visit(
        &mut self,
        depth: &mut PyramidDepth<'_>,
        scene: &GpuScene,
        inputs: (CutRecord, &CutRule),
        at: &Visit<'_>,
    ) -> Result<Counters, GpuError> {
        let mut tree = scene.tree()?;
        if let Err(error) = self.submit(depth, (scene, &mut tree), inputs, at) {
            // Pages count as resident whose copies were not submitted, and so do marks.
            tree.drop_all();
            self.stamp = 0;
            return Err(error);
        }
        drop(tree);
        depth.over.stream.wait(OPERATION)?;
        let counted = self.room.as_ref().and_then(|room| room.counted.elements().first().copied());
        Ok(counted.unwrap_or_else(Counters::zeroed))
    }

    fn submit(
        &mut self,
        depth: &mut PyramidDepth<'_>,
        (scene, tree): (&GpuScene, &mut Tree),
        (mut cut, rule): (CutRecord, &CutRule),
        at: &Visit<'_>,
    ) -> Result<(), GpuError> {
        let is_mapping = cut.mapped != 0;
        let Self { layout, mark, prepare, test, leave, room, upload, capacity, steps, stamps, stamp } = self;
        upload.bring(tree, scene.scene(), &at.lacks, rule)?;
        let are_stamps_stale = !at.mapped.is_empty() && matches!(*stamp, 0 | LAST_STAMP);
        if !at.mapped.is_empty() {
            *stamp = if are_stamps_stale { 1 } else { *stamp + 1 };
        }
        (cut.drawable_pages, cut.stamp) = (tree.drawable_pages(), *stamp);
        let bound = [
            depth.pyramid.texels(),
            tree.pages(),
            tree.nodes(),
            tree.drawables(),
            upload.appearances(),
            stamps,
        ];
        let make = || Room::new(scene.gpu(), layout, bound, *capacity);
        let room = reuse_or_make(room, |room| room.capacity == *capacity, make)?;
        room.cut.elements_mut().fill(cut);
        room.first.elements_mut().fill(at.counters.with_first(at.from.len() as u32));
        for (slot, entry) in room.first_entries.elements_mut().iter_mut().zip(&at.from) {
            *slot = *entry;
        }
        for (slot, id) in room.mapped.elements_mut().iter_mut().zip(at.mapped) {
            *slot = Entry::piece(*id);
        }
        // One step more than the last frame had, and then a dispatch for all that is left.
        let last = (steps[usize::from(!is_mapping)] + 1).clamp(4, STEPS as u32);
        let (constants, capacity) = (depth.constants, *capacity);
        let PyramidDepth { over: OverDepth { stream, depth, .. }, pyramid, halving, is_built, .. } = depth;
        let builds = !is_mapping && !std::mem::replace(is_built, true);
        let pass = if builds { Pass::Pyramid } else { Pass::Culling };
        stream.submit(OPERATION, Some(pass), |commands| {
            if builds {
                pyramid.build(commands, halving, depth);
            }
            commands.barrier(scope::TRAVERSAL, scope::FILL);
            upload.record(commands, tree);
            if are_stamps_stale {
                commands.fill(stamps, 0);
            }
            commands.copy_first(&room.first, &room.counters, 1);
            commands.copy_first(&room.first_entries, &room.entries, at.from.len());
            if !at.mapped.is_empty() {
                commands.copy(room.mapped.buffer(), &room.entries, &[room.second_list(at.mapped.len())]);
            }
            commands.barrier(scope::FILL, scope::TRAVERSAL);
            if !at.mapped.is_empty() {
                commands.bind(mark, &constants.of_step(0, capacity));
                commands.bind_set(mark, &room.set);
                commands.dispatch([(at.mapped.len() as u32).div_ceil(PREPARED_AT_ONCE), 1]);
                commands.barrier(scope::TRAVERSAL, scope::TRAVERSAL);
            }
            for step in 0..=last {
                let constants = constants.of_step(step, capacity);
                let dispatches = offset_of!(Counters, dispatches) + step as usize * size_of::<Dispatches>();
                let run = |pipeline: &Pipeline, groups: usize| {
                    commands.bind(pipeline, &constants);
                    commands.bind_set(pipeline, &room.set);
                    commands.dispatch_indirect(&room.counters, (dispatches + groups) as u64);
                    commands.barrier(scope::TRAVERSAL, scope::TRAVERSAL);
                };
                if step == last {
                    run(leave, offset_of!(Dispatches, prepare));
                    break;
                }
                run(prepare, offset_of!(Dispatches, prepare));
                if !is_mapping {
                    run(test, offset_of!(Dispatches, test));
                }
            }
            commands.barrier(scope::TRAVERSAL, scope::COPY_READ);
            let all = vk::BufferCopy { src_offset: 0, dst_offset: 0, size: size_of::<Counters>() as u64 };
            commands.copy(&room.counters, room.counted.buffer(), &[all]);
            commands.barrier(scope::COPY_WRITE, scope::HOST_READ);
            commands.barrier(scope::COMPUTE_WRITE, scope::HOST_READ);
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_audit::cases::{plant, plant_views};
    use trimaran_cull::{CutRule, LodRule, OcclusionTest as _, Viewport, WholeTraversal, lod_cut};
    use trimaran_proto::{DrawableId, Settings, ViewState};

    use super::{FIRST_CAPACITY, LAST_STAMP};
    use crate::common::{CheckedGpu, lacks_float64};
    use crate::tree::TreeBudget;
    use crate::{GpuScene, OccluderPass};

    /// The last frame's counterparts, and what is visible.
    type Found = (Option<Vec<DrawableId>>, Option<WholeTraversal>);

    /// The mappings and traversals of a walk through a plant, each ascending, with a tree and lists of these
    /// sizes at first. Then the most submissions that a frame took, and the size of the lists at the end.
    fn walk(gpu: &CheckedGpu, budget: Option<TreeBudget>, capacity: u32) -> (Vec<Found>, u64, u32) {
        let (seed, objects, size) = (7, 800, Viewport::new(160, 120).unwrap());
        let scene = plant(seed, objects, DVec3::ZERO).unwrap();
        let on_device = GpuScene::new(gpu, &scene).unwrap();
        if let Some(budget) = budget {
            on_device.limit_tree(budget);
        }
        // Two cullers in turn share the tree.
        let mut passes = [(); 2].map(|()| OccluderPass::new(&on_device, size).unwrap());
        let mut state = ViewState::from(Settings::new(size, LodRule::new(1.0).unwrap()));
        state.hidden = (0..800).step_by(3).collect();
        let rule = CutRule::new(&scene, &state);
        let (mut found, mut most) = (Vec::new(), 0);
        let mut last = Vec::new();
        let views = plant_views(seed, objects, DVec3::ZERO, size, 30).unwrap();
        for pass in &mut passes {
            pass.begin(&views[0]).unwrap();
            pass.hzb_test().unwrap().traversal().capacity = capacity;
        }
        for (frame, view) in views.into_iter().enumerate() {
            let pass = &mut passes[frame % 2];
            pass.begin(&view).unwrap();
            if frame == 7 {
                // The next stamps begin anew.
                pass.hzb_test().unwrap().traversal().stamp = LAST_STAMP - 1;
            }
            let before = pass.pass.unfinished_depth().stream.submissions();
            let mut mapped = pass.hzb_test().unwrap().map(&view, &rule, &last).unwrap();
            mapped.iter_mut().for_each(|mapped| mapped.sort_unstable());
            pass.draw(&[]).unwrap();
            let mut whole = pass.hzb_test().unwrap().traverse(&view, &rule).unwrap();
            most = most.max(pass.pass.over_depth().unwrap().stream.submissions() - before);
            whole.iter_mut().for_each(|whole| whole.visible.sort_unstable());
            // The next frame is the same if another size of the tree leaves this one to the host.
            last = lod_cut(&scene, &view, &rule);
            found.push((mapped, whole));
        }
        let [mut first, _] = passes;
        let capacity = first.hzb_test().unwrap().traversal().capacity;
        (found, most, capacity)
    }

    /// Pages that are absent are brought, and dropped where there is no room, and lists grow. The results are
    /// those of enough room.
    #[test]
    fn a_traversal_with_little_room_gives_the_same_after_more_submissions() {
        let Some(gpu) = CheckedGpu::open() else { return };
        if lacks_float64(&gpu) {
            return;
        }
        let (expected, with_room, capacity) = walk(&gpu, None, FIRST_CAPACITY);
        let visible: usize =
            expected.iter().flat_map(|(_, whole)| whole).map(|whole| whole.visible.len()).sum();
        let mapped: usize = expected.iter().flat_map(|(mapped, _)| mapped).map(Vec::len).sum();
        assert!(mapped > 1000 && expected.iter().all(|(mapped, _)| mapped.is_some()), "{mapped}");
        assert!(visible > 1000 && capacity == FIRST_CAPACITY, "{visible} drawables");
        // Room for four pages of nodes: all marked ones together do not fit.
        let (found, cramped, _) = walk(&gpu, Some(TreeBudget(4 * 64 * 168)), FIRST_CAPACITY);
        let same = |found: &[Found], expected: &[Found]| {
            let each = found.iter().zip(expected);
            each.clone().all(|((mapped, _), (right, _))| mapped.is_none() || mapped == right)
                && each.clone().all(|((_, whole), (_, right))| whole.is_none() || whole == right)
        };
        assert!(same(&found, &expected) && found.iter().all(|(_, whole)| whole.is_some()));
        assert!(cramped > with_room, "{cramped} submissions, {with_room} with room");
        let (found, _, grown) = walk(&gpu, None, 2);
        assert_eq!(found, expected);
        assert!(grown > 2 && grown < FIRST_CAPACITY, "lists of {grown}");
        // One page of each does not suffice where a node's drawables stand in two: the host culls then.
        let (found, ..) = walk(&gpu, Some(TreeBudget(1)), FIRST_CAPACITY);
        assert!(same(&found, &expected) && found.iter().any(|(_, whole)| whole.is_none()));
    }
}
