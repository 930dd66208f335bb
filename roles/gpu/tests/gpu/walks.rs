//! Whole walks on the device: occluders, culling and ID buffer, on the same hard cases as the CPU reference.

use std::sync::Arc;

use glam::DVec3;
use trimaran_audit::cases::{Case, hard_cases, plant, plant_views};
use trimaran_audit::{Placement, rasterize};
use trimaran_cull::{
    Culler, CutRule, DepthPyramid, HzbTest, LodRule, NoOccluders, View, Viewport, draw_order, lod_cut,
    occluders,
};
use trimaran_gpu::{GpuScene, ItemPass, OccluderPass};
use trimaran_proto::{DrawableId, ObjectSet, Settings, ViewState};
use trimaran_scene::random::Random;

use crate::common::{CheckedGpu, items, lacks_float64};
use crate::sections::random_sections;
use crate::three_passes::NOTHING;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TestKind {
    Query,
    Raster,
    Pyramid,
    /// The pyramid on the device, if supported.
    DevicePyramid,
}

const EXACT: [TestKind; 3] = [TestKind::Query, TestKind::Raster, TestKind::Pyramid];

/// The three roles on one device.
struct Walk<'g> {
    culler: Culler,
    rule: CutRule,
    occlusion_test: TestKind,
    occluder_pass: OccluderPass,
    item_pass: ItemPass,
    pyramid: DepthPyramid,
    last: Option<Vec<DrawableId>>,
    _gpu: &'g CheckedGpu,
}

/// A frame's drawables, and those that should be visible.
struct Frame {
    culled: Vec<[u32; 2]>,
    truth: Vec<[u32; 2]>,
    emitted: Vec<DrawableId>,
    cut: Vec<DrawableId>,
}

impl<'g> Walk<'g> {
    fn new(gpu: &'g CheckedGpu, case: &Case, rule: LodRule, occlusion_test: TestKind) -> Self {
        let scene = GpuScene::new(gpu, &case.scene).unwrap();
        let size = case.views[0].viewport();
        Self {
            culler: Culler::new(Arc::clone(&case.scene)),
            rule: rule.into(),
            occlusion_test,
            occluder_pass: OccluderPass::new(&scene, size).unwrap(),
            item_pass: ItemPass::new(&scene, size).unwrap(),
            pyramid: DepthPyramid::default(),
            last: None,
            _gpu: gpu,
        }
    }

    fn frame(&mut self, view: &View) -> Frame {
        let scene = Arc::clone(self.culler.scene());
        let mut emitted = self.cull(view);
        draw_order(&scene, view, &mut emitted);
        let mut cut = lod_cut(&scene, view, &self.rule);
        draw_order(&scene, view, &mut cut);
        self.last = Some(emitted.clone());
        Frame { culled: self.items(view, &emitted), truth: self.items(view, &cut), emitted, cut }
    }

    fn cull(&mut self, view: &View) -> Vec<DrawableId> {
        let Self { culler, rule, occlusion_test, occluder_pass, pyramid, last, .. } = self;
        let mut emitted = Vec::new();
        let sink = |ids: &[DrawableId]| emitted.extend_from_slice(ids);
        let Some(last) = last else {
            culler.cull(view, &*rule, &mut NoOccluders, sink).unwrap();
            return emitted;
        };
        let due = occluders(culler.scene(), view, &*rule, last).unwrap();
        occluder_pass.begin(view).unwrap();
        occluder_pass.draw(&due).unwrap();
        match occlusion_test {
            TestKind::Query => {
                culler.cull(view, &*rule, &mut occluder_pass.query_test().unwrap(), sink).unwrap();
            }
            TestKind::Raster => {
                culler.cull(view, &*rule, &mut occluder_pass.raster_test().unwrap(), sink).unwrap();
            }
            TestKind::Pyramid => {
                let image = occluder_pass.read_depth().unwrap();
                pyramid.rebuild(image);
                culler.cull(view, &*rule, &mut HzbTest::new(image, pyramid).unwrap(), sink).unwrap();
            }
            TestKind::DevicePyramid => {
                culler.cull(view, &*rule, &mut occluder_pass.hzb_test().unwrap(), sink).unwrap();
            }
        }
        emitted
    }

    fn items(&mut self, view: &View, ids: &[DrawableId]) -> Vec<[u32; 2]> {
        items(&mut self.item_pass, view, ids)
    }
}

/// Walks a case and asserts that culling changes no pixel; returns the drawn share of the cut.
fn assert_exact(gpu: &CheckedGpu, case: &Case, occlusion_test: TestKind) -> (usize, usize) {
    let (mut drawn, mut whole) = (0, 0);
    for epsilon in [0.5, 4.0] {
        let mut walk = Walk::new(gpu, case, LodRule::new(epsilon).unwrap(), occlusion_test);
        for view in &case.views {
            let Frame { culled, truth, emitted, cut } = walk.frame(view);
            let at =
                format!("{}, {occlusion_test:?}, epsilon {epsilon}, {}", case.name, view.camera().frame());
            let differing = culled.iter().zip(&truth).filter(|(a, b)| a != b).count();
            assert_eq!((culled.len(), differing), (truth.len(), 0), "pixels differ: {at}");
            (drawn, whole) = (drawn + emitted.len(), whole + cut.len());
        }
    }
    (drawn, whole)
}

#[test]
fn culling_is_exact_on_the_hard_cases_with_every_occlusion_test() {
    let Some(gpu) = CheckedGpu::open() else { return };
    for case in hard_cases().unwrap() {
        for occlusion_test in EXACT {
            assert_exact(&gpu, &case, occlusion_test);
        }
    }
}

/// Every frame of a walk has the same ids with both pyramids, in the same order.
#[test]
fn culling_by_the_depth_pyramid_gives_the_same_ids_on_host_and_device() {
    let Some(gpu) = CheckedGpu::open() else { return };
    if lacks_float64(&gpu) {
        return;
    }
    let mut cases = hard_cases().unwrap();
    cases.push(plant_case(DVec3::ZERO));
    for case in cases {
        for epsilon in [0.5, 4.0] {
            let rule = LodRule::new(epsilon).unwrap();
            let [mut host, mut device] = [TestKind::Pyramid, TestKind::DevicePyramid]
                .map(|occlusion_test| Walk::new(&gpu, &case, rule, occlusion_test));
            for view in &case.views {
                let [on_host, on_device] = [&mut host, &mut device].map(|walk| {
                    let ids = walk.cull(view);
                    walk.last = Some(ids.clone());
                    ids
                });
                assert_eq!(on_host, on_device, "{}, epsilon {epsilon}, {}", case.name, view.camera().frame());
            }
        }
    }
}

/// Other hidden objects, other sections and another error bound with every frame.
#[test]
fn culling_is_exact_whatever_is_hidden_or_cut_away_with_every_occlusion_test() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let case = plant_case(DVec3::new(1e6, 2e6, 0.0));
    let mut random = Random::new(5);
    for occlusion_test in EXACT {
        let first = LodRule::new(1.0).unwrap();
        let mut walk = Walk::new(&gpu, &case, first, occlusion_test);
        let (mut drawn, mut whole) = (0, 0);
        for view in &case.views {
            let (share, epsilon) = (random.between(0.0, 0.5), random.between(0.5, 8.0));
            let hidden: ObjectSet = (0..800).filter(|_| random.chance(share)).collect();
            let settings = Settings::new(view.viewport(), LodRule::new(epsilon).unwrap());
            let state = ViewState { hidden, ..ViewState::from(settings) };
            walk.rule = CutRule::new(&case.scene, &state);
            let view = view.with_sections(random_sections(&mut random, &case.scene));
            let Frame { culled, truth, emitted, cut } = walk.frame(&view);
            assert!(culled == truth, "{occlusion_test:?}, {}", view.camera().frame());
            (drawn, whole) = (drawn + emitted.len(), whole + cut.len());
        }
        assert!(drawn * 10 < whole * 9, "{occlusion_test:?} drew {drawn} of {whole}");
    }
}

fn plant_case(origin: DVec3) -> Case {
    let size = Viewport::new(320, 200).unwrap();
    Case {
        name: "plant",
        scene: plant(7, 800, origin).unwrap(),
        views: plant_views(7, 800, origin, size, 30).unwrap(),
    }
}

#[test]
fn culling_a_plant_is_exact_and_hides_most_of_it_with_every_occlusion_test() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let case = plant_case(DVec3::ZERO);
    for occlusion_test in EXACT {
        let (drawn, whole) = assert_exact(&gpu, &case, occlusion_test);
        assert!(drawn * 2 < whole, "{occlusion_test:?} drew {drawn} of {whole}");
    }
}

#[test]
fn the_item_buffer_agrees_with_the_reference_picture() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let case = plant_case(DVec3::new(1e6, 2e6, 0.0));
    let rule = LodRule::new(1.0).unwrap();
    let mut walk = Walk::new(&gpu, &case, rule, TestKind::Query);
    let (mut pixels, mut differing) = (0, 0);
    for view in case.views.iter().step_by(6) {
        let mut cut = lod_cut(&case.scene, view, rule);
        draw_order(&case.scene, view, &mut cut);
        let expected = rasterize(&case.scene, view, cut.iter().copied(), Placement::Single);
        let items = walk.items(view, &cut);
        let expected = expected.ids().iter().map(|id| id.map_or(NOTHING, |id| [id.drawable.0, id.triangle]));
        pixels += items.len();
        differing += expected.zip(&items).filter(|(expected, item)| expected != *item).count();
    }
    // Surfaces that touch tie within f32's rounding; all else must be the same.
    assert!(differing * 500 < pixels, "{differing} of {pixels} pixels differ");
}
