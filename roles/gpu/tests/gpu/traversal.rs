//! The whole tree traversed on the device: the host's ids, in the same steps, and its counters.

use std::sync::Arc;

use glam::DVec3;
use trimaran_audit::cases::{hard_cases, plant, plant_views};
use trimaran_cull::{
    CullStats, Culler, CutRule, DepthPyramid, HzbTest, LodRule, OcclusionTest, View, Viewport, occluders,
};
use trimaran_gpu::{GpuScene, OccluderPass};
use trimaran_proto::{DrawableId, ObjectSet, Settings, ViewState};
use trimaran_scene::{Level, Scene, random::Random};

use crate::common::{CheckedGpu, lacks_float64};
use crate::sections::random_sections;

/// The results of a traversal: its steps that give anything, and the counters.
type Given = (Vec<Vec<DrawableId>>, CullStats);

/// A culler's pass, with the last visible set as occluders.
struct Both {
    culler: Culler,
    pass: OccluderPass,
    last: Vec<DrawableId>,
}

impl Both {
    fn new(gpu: &CheckedGpu, scene: &Arc<Scene>, size: Viewport) -> Self {
        let on_device = GpuScene::new(gpu, scene).unwrap();
        let (culler, pass) = (Culler::new(Arc::clone(scene)), OccluderPass::new(&on_device, size).unwrap());
        Self { culler, pass, last: Vec::new() }
    }

    /// Asserts that the device gives what the host does, and returns that.
    fn assert_same(&mut self, view: &View, rule: &CutRule, at: &str) -> Given {
        let Self { culler, pass, last } = self;
        let due = occluders(culler.scene(), view, rule, last).unwrap();
        pass.begin(view).unwrap();
        let root = &culler.scene().nodes()[0];
        let top: Vec<DrawableId> =
            culler.scene().levels(root).next_back().map(Level::first).into_iter().collect();
        for ids in [last.as_slice(), &top] {
            let expected = occluders(culler.scene(), view, rule, ids).unwrap();
            let mapped = pass.hzb_test().unwrap().map(view, rule, ids).unwrap();
            assert_eq!(mapped.map(ascending), Some(ascending(expected)), "mapping: {at}");
        }
        pass.draw(&due).unwrap();
        // The device first, so that it does not benefit from the host's wait.
        let mut test = pass.hzb_test().unwrap();
        assert!(test.traverse(view, rule).unwrap().is_some(), "the device did not traverse: {at}");
        let on_device = given(culler, view, rule, &mut test);
        let image = pass.read_depth().unwrap();
        let pyramid = DepthPyramid::over(image);
        let on_host = given(culler, view, rule, &mut HzbTest::new(image, &pyramid).unwrap());
        assert_eq!(on_device, on_host, "{at}");
        *last = on_host.0.concat();
        on_host
    }
}

fn ascending(mut ids: Vec<DrawableId>) -> Vec<DrawableId> {
    ids.sort_unstable();
    ids
}

fn given(culler: &mut Culler, view: &View, rule: &CutRule, test: &mut impl OcclusionTest) -> Given {
    let mut steps = Vec::new();
    let stats = culler.cull(view, rule, test, |ids| steps.push(ids.to_vec())).unwrap();
    (steps, stats)
}

fn open() -> Option<CheckedGpu> {
    CheckedGpu::open().filter(|gpu| !lacks_float64(gpu))
}

#[test]
fn hard_cases_are_culled_as_on_the_host() {
    let Some(gpu) = open() else { return };
    for case in hard_cases().unwrap() {
        for epsilon in [0.5, 4.0] {
            let rule = LodRule::new(epsilon).unwrap().into();
            let mut both = Both::new(&gpu, &case.scene, case.views[0].viewport());
            for view in &case.views {
                let at = format!("{}, {epsilon} px, {}", case.name, view.camera().frame());
                both.assert_same(view, &rule, &at);
            }
        }
    }
}

/// Other hidden and see-through objects, other sections, and another error bound with every frame.
#[test]
fn a_plant_is_culled_as_on_the_host_whatever_is_hidden_or_cut_away() {
    let Some(gpu) = open() else { return };
    let (origin, size) = (DVec3::new(1e6, 2e6, 0.0), Viewport::new(320, 200).unwrap());
    let scene = plant(7, 800, origin).unwrap();
    let mut both = Both::new(&gpu, &scene, size);
    let mut random = Random::new(5);
    let mut all = CullStats::default().counts;
    let (mut steps, mut changed) = (0, 0);
    for view in plant_views(7, 800, origin, size, 120).unwrap() {
        let mut state =
            ViewState::from(Settings::new(size, LodRule::new(random.between(-1.0, 7.0).exp2()).unwrap()));
        if random.chance(0.5) {
            let share = random.between(0.0, 0.5);
            let mut some = |share: f64| -> ObjectSet { (0..800).filter(|_| random.chance(share)).collect() };
            (state.hidden, state.see_through) = (some(share), Some(some(0.1)));
            changed += 1;
        }
        let rule = CutRule::new(&scene, &state);
        let sections = random_sections(&mut random, &scene);
        let view = if random.chance(0.3) { view.with_sections(sections) } else { view };
        let (given, stats) = both.assert_same(&view, &rule, &view.camera().frame().to_string());
        steps += given.len();
        all.hidden += stats.counts.hidden;
        all.outside += stats.counts.outside;
        all.emitted += stats.counts.emitted;
        all.eye_inside += stats.counts.eye_inside;
    }
    assert!(steps > 50 && changed > 20, "{steps} steps, {changed} changed states");
    assert!(all.hidden > 1000 && all.outside > 1000 && all.emitted > 1000 && all.eye_inside > 0, "{all:?}");
}
