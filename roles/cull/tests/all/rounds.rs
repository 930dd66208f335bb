//! Culling in rounds, on the f64 reference.

use std::convert::Infallible;
use std::sync::Arc;

use glam::DVec3;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_audit::{Placement, rasterize};
use trimaran_cull::{
    CullStats, Culler, CutRule, DepthImage, DepthPyramid, HzbError, HzbTest, LodRule, OcclusionTest, Outline,
    RoundRule, Rounds, StepCounts, TestBox, TriangleBudget, View, Viewport, WholeTraversal, draw_order,
    lod_cut, occluders, triangles,
};
use trimaran_proto::DrawableId;
use trimaran_scene::{FlatObject, Scene, SceneArrays};

use crate::pieces::{square, view};

/// Occluders, and the depth that the last of them completed.
pub(crate) struct Device {
    scene: Arc<Scene>,
    view: View,
    occluders: Vec<DrawableId>,
    depth: Vec<f32>,
    pyramid: DepthPyramid,
}

impl Device {
    pub(crate) fn new(scene: &Arc<Scene>, view: &View, occluders: &[DrawableId]) -> Self {
        let (depth, pyramid) = (Vec::new(), DepthPyramid::default());
        let mut device =
            Self { scene: Arc::clone(scene), view: *view, occluders: Vec::new(), depth, pyramid };
        device.add(occluders).unwrap();
        device
    }

    fn image(&self) -> DepthImage<'_> {
        DepthImage::new(self.view.viewport(), &self.depth).unwrap()
    }

    pub(crate) fn add(&mut self, occluders: &[DrawableId]) -> Result<(), HzbError> {
        assert!(occluders.iter().all(|id| !self.occluders.contains(id)), "each is drawn once");
        self.occluders.extend_from_slice(occluders);
        let drawn = self.occluders.iter().copied();
        self.depth = rasterize(&self.scene, &self.view, drawn, Placement::Exact).depth32();
        self.pyramid = DepthPyramid::over(self.image());
        Ok(())
    }
}

impl OcclusionTest for Device {
    type Error = HzbError;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), HzbError> {
        HzbTest::new(self.image(), &self.pyramid)?.test(view, boxes, visible)
    }

    fn outline(&self) -> Outline {
        Outline::OnScreen
    }
}

struct Culled {
    /// The output, part by part.
    parts: Vec<Vec<DrawableId>>,
    rounds: u32,
    stats: CullStats,
}

impl Culled {
    fn visible(&self) -> Vec<DrawableId> {
        self.parts.concat()
    }
}

struct Case {
    scene: Arc<Scene>,
    views: Vec<View>,
    rule: LodRule,
}

impl Case {
    fn new(seed: u64, views: u32) -> Self {
        let viewport = Viewport::new(96, 80).unwrap();
        let scene = plant(seed, 400, DVec3::ZERO).unwrap();
        let views = plant_views(seed, 400, DVec3::ZERO, viewport, views).unwrap();
        Self { scene, views, rule: LodRule::new(1.0).unwrap() }
    }

    /// Culls a frame whose first round has `last` as occluders.
    fn cull(&self, view: &View, last: &[DrawableId], rule: RoundRule) -> Culled {
        let mut due = occluders(&self.scene, view, self.rule, last).unwrap();
        let mut mapped = due.clone();
        mapped.sort_unstable();
        due.truncate(last.len() / 4); // within a budget
        let mut device = Device::new(&self.scene, view, &due);
        let mut culler = Culler::new(Arc::clone(&self.scene));
        let traversal = culler.traverse(view, self.rule, &device).unwrap();
        let mut rounds = Rounds::new(traversal, &mapped, &due, rule);
        let mut parts = Vec::new();
        while let Some(ids) = rounds.next(&mut device, Device::add).unwrap() {
            parts.push(ids.to_vec());
        }
        assert!(rounds.occluders().iter().all(|id| device.occluders.contains(id)));
        Culled { parts, rounds: rounds.rounds(), stats: rounds.stats() }
    }

    /// Up to `most` rounds of a tenth of the cut's triangles.
    fn rounds(&self, view: &View, most: u32) -> RoundRule {
        let cut = lod_cut(&self.scene, view, self.rule);
        RoundRule { most, budget: TriangleBudget(triangles(&self.scene, &cut) / 10) }
    }
}

#[test]
fn rounds_hide_what_the_first_one_could_not_and_never_a_pixel() {
    let mut hidden_later = 0;
    for seed in 1..5 {
        let case = Case::new(seed, 6);
        for view in &case.views {
            let one = case.cull(view, &[], RoundRule::ONE);
            let culled = case.cull(view, &[], case.rounds(view, 4));
            assert!(culled.rounds <= 4);
            hidden_later += culled.stats.hidden_later;

            // The same traversal, less the drawables hidden later, in the same order.
            let (all, visible) = (one.visible(), culled.visible());
            let mut kept = all.iter().filter(|id| visible.contains(id));
            assert!(visible.iter().all(|id| kept.next() == Some(id)));
            assert_eq!(all.len(), visible.len() + culled.stats.hidden_later as usize);
            assert_eq!(visible.len(), culled.stats.counts.emitted as usize);

            let shown = |ids: &[DrawableId]| {
                let mut ids = ids.to_vec();
                draw_order(&case.scene, view, &mut ids);
                rasterize(&case.scene, view, ids, Placement::Exact)
            };
            let truth = shown(&lod_cut(&case.scene, view, case.rule));
            assert_eq!(shown(&visible).differing_pixels(&truth), 0);
            assert_eq!(case.cull(view, &[], case.rounds(view, 4)).visible(), visible, "the same again");
        }
    }
    assert!(hidden_later > 500, "{hidden_later}");
}

#[test]
fn a_calm_frame_has_one_round_and_its_ids_leave_level_by_level() {
    let case = Case::new(1, 6);
    let mut parts = 0;
    for view in &case.views {
        let jumped = case.cull(view, &[], case.rounds(view, 4));
        assert!(jumped.rounds > 1 && jumped.stats.tested_again > 0);
        // Few of the last frame's drawables are drawn, so much more than they shows; but nothing is new.
        let last = lod_cut(&case.scene, view, case.rule);
        let calm = case.cull(view, &last, case.rounds(view, 4));
        assert_eq!((calm.rounds, calm.stats.tested_again), (1, 0));
        assert_eq!(calm.parts, case.cull(view, &last, RoundRule::ONE).parts);
        parts += calm.parts.len();
    }
    assert!(parts > case.views.len());
}

/// Finds the given drawables. Of each batch after that it shows the first boxes, as many as `shown` says.
struct Scripted {
    found: WholeTraversal,
    shown: std::slice::Iter<'static, usize>,
}

impl OcclusionTest for Scripted {
    type Error = Infallible;

    fn test(&mut self, _: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
        let shown = *self.shown.next().unwrap();
        visible.clear();
        visible.extend((0..boxes.len()).map(|place| u32::from(place < shown)));
        Ok(())
    }

    fn traverse(&mut self, _: &View, _: &CutRule) -> Result<Option<WholeTraversal>, Infallible> {
        Ok(Some(self.found.clone()))
    }
}

/// Per step the triangles of its drawables. The first `last` of all are of the last frame. Returns how many
/// leave at a time, and how many each further round draws.
fn play(
    steps: &[&[usize]],
    last: u32,
    budget: u64,
    most: u32,
    shown: &'static [usize],
) -> (Vec<usize>, Vec<usize>) {
    let objects = (0_u8..).zip(steps.concat()).map(|(place, triangles)| {
        let square = square(0.0, -10.0 - f32::from(place), 1.0);
        let positions = square.positions[..3].to_vec();
        FlatObject { positions, indices: [0, 1, 2].repeat(triangles), ..square }
    });
    let scene = Arc::new(Scene::from_arrays(SceneArrays::flat(&objects.collect::<Vec<_>>())).unwrap());
    let counts = |step: &&[usize]| StepCounts { whole: step.len() as u32, ..StepCounts::default() };
    let visible = (0..scene.drawables().len() as u32).map(DrawableId).collect();
    let found = WholeTraversal { visible, steps: steps.iter().map(counts).collect() };
    let (mut test, view) = (Scripted { found, shown: shown.iter() }, view(0.0, 1.0));
    let last: Vec<_> = (0..last).map(DrawableId).collect();
    let mut culler = Culler::new(scene);
    let traversal = culler.traverse(&view, LodRule::new(1.0).unwrap(), &test).unwrap();
    let rule = RoundRule { most, budget: TriangleBudget(budget) };
    let (mut rounds, mut left) = (Rounds::new(traversal, &last, &[], rule), Vec::new());
    let mut drawn: Vec<Vec<DrawableId>> = Vec::new();
    let mut draw = |_: &mut Scripted, ids: &[DrawableId]| {
        drawn.push(ids.to_vec());
        Ok(())
    };
    while let Some(ids) = rounds.next(&mut test, &mut draw).unwrap() {
        left.push(ids.len());
    }
    assert_eq!(rounds.rounds() as usize, 1 + drawn.len());
    assert_eq!(rounds.occluders(), drawn.concat());
    (left, drawn.iter().map(Vec::len).collect())
}

#[test]
fn a_further_round_comes_where_much_is_new_and_the_last_one_hid_much() {
    let one = |steps: &[&[usize]], last, budget, shown| play(steps, last, budget, 4, shown);
    // Ids leave at once up to a 32nd of the budget.
    assert_eq!(one(&[&[2], &[1], &[2]], 0, 64, &[]), (vec![1, 2], vec![]));
    // Less than half a budget is new, and just half.
    assert_eq!(one(&[&[4]], 0, 10, &[]), (vec![1], vec![]));
    assert_eq!(one(&[&[5]], 0, 10, &[1]), (vec![1], vec![1]));
    // Less than a quarter of all is new, and just a quarter.
    assert_eq!(one(&[&[32, 4]], 1, 8, &[]), (vec![2], vec![]));
    assert_eq!(one(&[&[12, 4]], 1, 8, &[2]), (vec![2], vec![1]));
    // Sixteen of one triangle: a round draws up to two budgets, then what is left.
    let sixteen = |most, shown| play(&[&[1; 16]], 0, 3, most, shown);
    assert_eq!(sixteen(4, &[8, 8]), (vec![8], vec![6, 2]), "half of them hidden");
    assert_eq!(sixteen(4, &[9]), (vec![9], vec![6]), "less than half");
    assert_eq!(sixteen(2, &[8]), (vec![8], vec![6]), "no more rounds");
}
