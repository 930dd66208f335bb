//! Culling in rounds, on the f64 reference.

use std::sync::Arc;

use glam::DVec3;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_audit::{Placement, rasterize};
use trimaran_cull::{
    CullStats, Culler, DepthImage, DepthPyramid, HzbError, HzbTest, LodRule, OcclusionTest, Outline,
    RoundRule, Rounds, TestBox, TriangleBudget, View, Viewport, draw_order, lod_cut, occluders, triangles,
};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

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
