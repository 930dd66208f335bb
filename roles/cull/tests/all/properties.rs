//! Properties of cuts, occluders and orders in any plant and from anywhere in it.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::DVec3;
use proptest::prelude::*;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_audit::{ReferenceWalkthrough, Testing};
use trimaran_cull::{
    Choice, CullError, Culler, LodCut, LodRule, NoOccluders, OccluderError, OccluderMapper, TestBox, View,
    Viewport, draw_order, lod_cut, occluders,
};
use trimaran_proto::DrawableId;
use trimaran_scene::{NodeId, Scene};

const OBJECTS: usize = 150;

fn setting(seed: u64) -> (Arc<Scene>, Vec<View>) {
    let viewport = Viewport::new(64, 48).unwrap();
    (
        plant(seed, OBJECTS, DVec3::ZERO).unwrap(),
        plant_views(seed ^ 1, OBJECTS, DVec3::ZERO, viewport, 14).unwrap(),
    )
}

fn rule(epsilon: f64) -> LodRule {
    LodRule::new(epsilon).unwrap()
}

/// How many nodes of the cut there are from a node up to the root.
fn drawn_above(scene: &Scene, cut: &BTreeSet<u32>, node: u32) -> usize {
    scene.ancestors(NodeId(node)).filter(|(above, _)| cut.contains(&above.0)).count()
}

fn nodes_of(scene: &Scene, ids: &[DrawableId]) -> BTreeSet<u32> {
    ids.iter().map(|id| scene.drawables()[id.index()].node).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_cut_is_an_antichain_that_covers_every_leaf_in_the_frustum(seed: u64, epsilon in 0.1..100.0_f64) {
        let (scene, views) = setting(seed);
        for view in views.iter().step_by(4) {
            let cut = LodCut::new(&scene, view, rule(epsilon));
            let levels = cut.levels();
            let drawn: BTreeSet<u32> =
                levels.iter().map(|level| scene.drawables()[level.first().index()].node).collect();
            prop_assert_eq!(drawn.len(), levels.len(), "one level a node");
            let pieces: BTreeSet<DrawableId> = levels.iter().flat_map(|level| level.pieces()).collect();
            let mut outside = pieces;
            cut.drawables().iter().for_each(|id| assert!(outside.remove(id), "{id} twice, or of no level"));
            for id in outside {
                prop_assert!(cut.outside(&scene.part(id).unwrap().1), "{} is lost", id);
            }
            for (leaf, node) in (0..).zip(scene.nodes()).filter(|(_, node)| node.is_leaf()) {
                let above = drawn_above(&scene, &drawn, leaf);
                prop_assert!(above <= 1, "leaf {} is drawn {} times", leaf, above);
                prop_assert!(above == 1 || cut.outside(node), "leaf {} is not drawn", leaf);
            }
        }
    }

    #[test]
    fn what_looks_large_is_of_the_cut_and_no_more_than_the_width_allows(seed: u64, epsilon in 0.1..20.0_f64) {
        let (scene, views) = setting(seed);
        for view in views.iter().step_by(4) {
            let cut = LodCut::new(&scene, view, rule(epsilon));
            let all = cut.drawables();
            let set: BTreeSet<DrawableId> = all.iter().copied().collect();
            prop_assert_eq!(&cut.large_drawables(scene.nodes().len()), &all);
            for width in [1, 2, 8, 64] {
                let large = cut.large_drawables(width);
                prop_assert!(large.iter().all(|id| set.contains(id)), "{} nodes a level", width);
                // Each level refines at most this many nodes, of up to eight children each.
                prop_assert!(large.len() <= 8 * width * 32, "{} of {}", large.len(), width);
            }
        }
    }

    #[test]
    fn a_looser_bound_never_draws_finer(seed: u64, epsilon in 0.1..50.0_f64, looser in 1.0..10.0_f64) {
        let (scene, views) = setting(seed);
        let (fine, coarse) = (rule(epsilon), rule(epsilon * looser));
        for (index, node) in (0..).zip(scene.nodes()) {
            let at = |rule| LodCut::new(&scene, &views[0], rule).choose(NodeId(index), node);
            match (at(fine), at(coarse)) {
                (Choice::Draw(a), Choice::Draw(b)) => prop_assert!(a.first() <= b.first()),
                (Choice::Draw(a), Choice::Refine) => {
                    prop_assert!(false, "{:?} is good enough only for the finer rule", a);
                }
                (Choice::Refine, _) => {}
                (Choice::Nothing, _) | (_, Choice::Nothing) => prop_assert!(false, "nothing is hidden"),
            }
        }
        let drawn = |rule| nodes_of(&scene, &lod_cut(&scene, &views[0], rule));
        let coarser = drawn(coarse);
        for node in drawn(fine) {
            prop_assert_eq!(drawn_above(&scene, &coarser, node), 1, "node {} or one above it", node);
        }
    }

    #[test]
    fn occluders_are_the_new_cut_s_share_of_the_old_one(seed: u64, epsilon in 0.5..20.0_f64, batch in 1..40_usize) {
        let (scene, views) = setting(seed);
        let rule = rule(epsilon);
        let mut mapper = OccluderMapper::new(scene.clone(), views[0], rule);
        for pair in views.windows(2) {
            let old = lod_cut(&scene, &pair[0], rule);
            let new: BTreeSet<DrawableId> = lod_cut(&scene, &pair[1], rule).into_iter().collect();
            mapper.begin(pair[1], rule);
            let mut due = Vec::new();
            // Every other id, some of them twice.
            let sent: Vec<DrawableId> = old.iter().copied().step_by(2).chain(old.iter().copied().step_by(6)).collect();
            for ids in sent.chunks(batch) {
                mapper.push(ids, &mut due).unwrap();
            }
            let each: BTreeSet<DrawableId> = due.iter().copied().collect();
            prop_assert_eq!(each.len(), due.len(), "each once");
            prop_assert!(each.is_subset(&new), "all of them on the new cut");
            let at_once: BTreeSet<DrawableId> = occluders(&scene, &pair[1], rule, &sent).unwrap().into_iter().collect();
            prop_assert_eq!(&each, &at_once, "however they are batched");
            // All of the new cut on a path of a sent id is due, and of the level of one, only that piece.
            let old: BTreeSet<DrawableId> = sent.iter().copied().collect();
            for &id in &new {
                let own = scene.drawables()[id.index()];
                let related = |&other: &DrawableId| {
                    let old = scene.drawables()[other.index()];
                    if old.level(other) == own.level(id) {
                        return other == id;
                    }
                    is_below(&scene, old.node, own.node) || is_below(&scene, own.node, old.node)
                };
                prop_assert_eq!(old.iter().any(related), each.contains(&id), "{}", id);
            }
        }
    }

    #[test]
    fn drawing_order_does_not_depend_on_the_set(seed: u64) {
        let (scene, views) = setting(seed);
        let mut all: Vec<DrawableId> = (0..scene.drawables().len() as u32).map(DrawableId).collect();
        draw_order(&scene, &views[0], &mut all);
        let mut some: Vec<DrawableId> = all.iter().rev().copied().filter(|id| id.0 % 3 == 0).collect();
        draw_order(&scene, &views[0], &mut some);
        all.retain(|id| id.0 % 3 == 0);
        prop_assert_eq!(all, some);
    }

    #[test]
    fn what_is_emitted_holds_all_that_is_seen(seed: u64, epsilon in 0.5..20.0_f64) {
        let (scene, views) = setting(seed);
        for testing in [Testing::Rasterized, Testing::Pyramid] {
            let mut walk = ReferenceWalkthrough::new(scene.clone(), rule(epsilon)).testing(testing);
            for view in &views {
                let report = walk.frame(view).unwrap();
                prop_assert_eq!(&report.false_culled, &[]);
                prop_assert_eq!(report.differing_pixels, 0);
            }
        }
    }
}

fn is_below(scene: &Scene, node: u32, top: u32) -> bool {
    scene.ancestors(NodeId(node)).any(|(above, _)| above.0 == top)
}

#[test]
fn without_occluders_all_of_the_cut_in_the_frustum_is_emitted_and_every_node_is_accounted_for() {
    let (scene, views) = setting(3);
    let mut culler = Culler::new(scene.clone());
    for view in &views {
        let mut emitted = BTreeSet::new();
        let stats = culler
            .cull(view, rule(2.0), &mut NoOccluders, |ids| assert!(ids.iter().all(|id| emitted.insert(*id))))
            .unwrap();
        let cut: BTreeSet<DrawableId> = lod_cut(&scene, view, rule(2.0)).into_iter().collect();
        assert!(emitted.is_subset(&cut));
        let counts = stats.counts;
        assert_eq!(counts.emitted as usize, emitted.len());
        assert_eq!(counts.visited, counts.outside + counts.hidden + counts.emitted + counts.refined);
        assert_eq!(counts.visited - counts.outside, counts.tested + counts.near_visible + counts.eye_inside);
        assert_eq!((counts.hidden, counts.not_finite), (0, 0));
    }
}

#[test]
fn ids_of_another_scene_are_refused() {
    let (scene, views) = setting(3);
    let count = scene.drawables().len();
    let foreign = DrawableId(count as u32);
    match occluders(&scene, &views[0], rule(2.0), &[foreign]) {
        Err(OccluderError::Unknown { id, count: of }) => assert_eq!((id, of), (foreign, count)),
        other => panic!("{other:?}"),
    }
}

/// A setting at the view that sees most.
fn busy_setting() -> (Arc<Scene>, View) {
    let (scene, views) = setting(3);
    let busiest = views.into_iter().max_by_key(|view| lod_cut(&scene, view, rule(2.0)).len()).unwrap();
    (scene, busiest)
}

/// An occlusion test that breaks its contract, or fails.
struct Broken(Result<usize, &'static str>);

#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Lost(&'static str);

impl trimaran_cull::OcclusionTest for Broken {
    type Error = Lost;

    fn test(&mut self, _: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Lost> {
        let missing = self.0.map_err(Lost)?;
        visible.resize(boxes.len() - missing, 1);
        Ok(())
    }
}

#[test]
fn an_occlusion_test_that_fails_or_miscounts_stops_the_traversal() {
    let (scene, view) = busy_setting();
    let mut culler = Culler::new(scene);
    let short = culler.cull(&view, rule(2.0), &mut Broken(Ok(1)), |_| ()).unwrap_err();
    assert!(matches!(short, CullError::AnswerCount { boxes, answers } if answers + 1 == boxes), "{short}");
    let lost = culler.cull(&view, rule(2.0), &mut Broken(Err("device lost")), |_| ()).unwrap_err();
    assert!(matches!(lost, CullError::Test(Lost("device lost"))), "{lost}");
    let few = rule(2.0).stopping_at_few_pixels(true);
    let uncounted = culler.cull(&view, few, &mut Broken(Ok(0)), |_| ()).unwrap_err();
    assert!(matches!(uncounted, CullError::NeedsPixelCount), "{uncounted}");
}

/// An occlusion test that finds every box visible at this many pixels.
struct Shows(u32);

impl trimaran_cull::OcclusionTest for Shows {
    type Error = std::convert::Infallible;

    fn test(&mut self, _: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Self::Error> {
        visible.resize(boxes.len(), self.0);
        Ok(())
    }

    fn answer(&self) -> trimaran_cull::Answer {
        trimaran_cull::Answer::PixelCount
    }
}

#[test]
fn at_few_pixels_the_traversal_stops_only_if_the_rule_says_so() {
    let (scene, view) = busy_setting();
    let mut culler = Culler::new(scene);
    let mut stopped = |pixels, on| {
        let rule = rule(4.0).stopping_at_few_pixels(on);
        culler.cull(&view, rule, &mut Shows(pixels), |_| ()).unwrap().counts.few_pixels
    };
    assert!(stopped(3, true) > 0);
    assert_eq!((stopped(4, true), stopped(3, false)), (0, 0));
}
