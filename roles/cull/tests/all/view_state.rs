//! Hidden, isolated and see-through objects, and sections: their effect on the LOD cut, and exact culling
//! with them.
#![allow(clippy::unwrap_used, clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;

use glam::DVec3;
use proptest::prelude::*;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_audit::{Placement, ReferenceWalkthrough, Testing, rasterize};
use trimaran_cull::{CutRule, LodRule, View, Viewport, lod_cut, select_occluders};
use trimaran_proto::{
    Appearance, DrawableId, ObjectSet, Section, SectionBox, SectionPlane, Sections, Settings, ViewState,
};
use trimaran_scene::random::Random;
use trimaran_scene::{Node, Scene, SceneArrays};

use crate::pieces::square;

const OBJECTS: u32 = 300;

fn setting(seed: u64) -> (Arc<Scene>, Vec<View>) {
    let size = Viewport::new(64, 48).unwrap();
    let scene = plant(seed, OBJECTS as usize, DVec3::ZERO).unwrap();
    (scene, plant_views(seed, OBJECTS as usize, DVec3::ZERO, size, 8).unwrap())
}

fn state(epsilon: f64) -> ViewState {
    let size = Viewport::new(64, 48).unwrap();
    ViewState::from(Settings::new(size, LodRule::new(epsilon).unwrap()))
}

fn some_objects(random: &mut Random, share: f64) -> ObjectSet {
    (0..OBJECTS).filter(|_| random.between(0.0, 1.0) < share).collect()
}

fn some_sections(random: &mut Random, scene: &Scene) -> Sections {
    let (min, max) = scene.nodes()[0].world_box();
    let sections: Vec<Section> = (0..random.below(3))
        .map(|_| {
            let place = random.point(min, max);
            if random.below(2) == 0 {
                let direction = random.direction().to_array();
                Section::Plane(SectionPlane::new(place.to_array(), direction).unwrap())
            } else {
                let half = (max - min) * random.between(0.2, 0.6);
                let corners = [place - half, place + half].map(|corner| corner.to_array());
                Section::Box(SectionBox::new(corners[0], corners[1]).unwrap())
            }
        })
        .collect();
    Sections::new(&sections).unwrap()
}

fn object_of(scene: &Scene, id: DrawableId) -> u32 {
    scene.nodes()[scene.drawables()[id.index()].node as usize].object
}

/// The objects with something on the cut, each with all that is below a node of several.
fn objects_on(scene: &Scene, cut: &[DrawableId]) -> BTreeSet<u32> {
    let mut open: Vec<u32> = cut.iter().map(|id| scene.drawables()[id.index()].node).collect();
    let mut objects = BTreeSet::new();
    while let Some(at) = open.pop() {
        let node = &scene.nodes()[at as usize];
        if node.object == Node::NONE { open.extend(node.children()) } else { _ = objects.insert(node.object) }
    }
    objects
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_cut_has_what_is_shown_and_nothing_that_is_hidden(seed: u64, epsilon in 0.5..40.0_f64) {
        let (scene, views) = setting(seed);
        let mut random = Random::new(seed);
        let hidden = some_objects(&mut random, 0.3);
        let isolated = (seed % 2 == 0).then(|| some_objects(&mut random, 0.5));
        let see_through = some_objects(&mut random, 0.2);
        let state = ViewState { hidden, isolated, see_through: Some(see_through), ..state(epsilon) };
        let rule = CutRule::new(&scene, &state);
        for view in &views {
            let all = objects_on(&scene, &lod_cut(&scene, view, LodRule::new(1e-6).unwrap()));
            let cut = lod_cut(&scene, view, &rule);
            let shown = objects_on(&scene, &cut);
            prop_assert!(shown.iter().all(|object| state.appearance(*object, false) != Appearance::Hidden));
            // Coarser levels may bring in objects beside the picture; the finest ones show just these.
            let is_shown = |object: &&u32| state.appearance(**object, false) != Appearance::Hidden;
            for object in all.iter().filter(is_shown) {
                prop_assert!(shown.contains(object), "object {} is missing", object);
            }
            for id in cut {
                let below = objects_on(&scene, &[id]);
                let through = |object: &u32| state.appearance(*object, false) == Appearance::SeeThrough;
                prop_assert_eq!(below.iter().all(through), rule.is_see_through(&scene, id));
                prop_assert_eq!(below.iter().any(through), rule.is_see_through(&scene, id), "not mixed");
            }
        }
    }

    /// Another view state with every frame, over random walks.
    #[test]
    fn culling_is_exact_whatever_is_hidden_or_cut_away(seed: u64) {
        let (scene, views) = setting(seed);
        let mut random = Random::new(seed);
        for testing in [Testing::Rasterized, Testing::Pyramid] {
            let mut walk = ReferenceWalkthrough::new(scene.clone(), LodRule::new(2.0).unwrap()).testing(testing);
            for view in &views {
                let share = random.between(0.0, 0.9);
                let hidden = some_objects(&mut random, share);
                let state = ViewState { hidden, ..state(random.between(0.5, 20.0)) };
                walk.set_rule(CutRule::new(&scene, &state));
                let view = view.with_sections(some_sections(&mut random, &scene));
                let report = walk.frame(&view).unwrap();
                prop_assert_eq!(&report.false_culled, &[]);
                prop_assert_eq!(report.differing_pixels, 0);
            }
        }
    }

    /// Nodes wholly beyond a section are not drawn.
    #[test]
    fn sections_cut_pixels_away_and_nodes_beyond_them(seed: u64) {
        let (scene, views) = setting(seed);
        let mut random = Random::new(seed);
        let rule = LodRule::new(0.5).unwrap();
        for view in &views {
            let cut_view = view.with_sections(some_sections(&mut random, &scene));
            let whole = lod_cut(&scene, view, rule);
            let cut = lod_cut(&scene, &cut_view, rule);
            prop_assert!(cut.iter().all(|id| whole.contains(id)));
            // With nodes beyond a section or without, the picture is the same.
            let picture = |ids: &[DrawableId]| {
                rasterize(&scene, &cut_view, ids.iter().copied(), Placement::Exact)
            };
            prop_assert_eq!(picture(&whole).differing_pixels(&picture(&cut)), 0);
        }
    }
}

#[test]
fn a_plane_before_the_eye_cuts_everything_away() {
    let (scene, views) = setting(1);
    let rule = LodRule::new(1.0).unwrap();
    let (min, max) = scene.nodes()[0].world_box();
    for (location, direction, left) in [(min, DVec3::X, 0), (max, DVec3::X, 1), (max, -DVec3::Y, 0)] {
        let plane = SectionPlane::new(
            (location + direction * -1e-3 * f64::from(1 - left)).to_array(),
            direction.to_array(),
        );
        let sections = Sections::new(&[Section::Plane(plane.unwrap())]).unwrap();
        for view in &views {
            let cut = lod_cut(&scene, &view.with_sections(sections), rule);
            let whole = lod_cut(&scene, view, rule);
            assert_eq!(cut, if left == 0 { Vec::new() } else { whole }, "{location} {direction}");
        }
    }
}

#[test]
fn what_is_seen_through_is_no_occluder() {
    let (scene, views) = setting(5);
    let see_through: ObjectSet = (0..OBJECTS).step_by(2).collect();
    let state = ViewState { see_through: Some(see_through), ..state(1.0) };
    let rule = CutRule::new(&scene, &state);
    let cut = lod_cut(&scene, &views[0], &rule);
    let mut solid = cut.clone();
    rule.retain_solid(&scene, &mut solid);
    assert!(!solid.is_empty() && solid.len() < cut.len());
    let is_solid = |id: &DrawableId| state.appearance(object_of(&scene, *id), false) == Appearance::Solid;
    assert!(solid.iter().all(is_solid));
    let mut all = cut;
    CutRule::from(state.lod).retain_solid(&scene, &mut all);
    select_occluders(&scene, &views[0], &mut all, trimaran_cull::TriangleBudget(u64::MAX));
    assert!(all.len() > solid.len(), "a rule of levels alone takes all");
}

/// Of three objects the first is hidden, and the model has the second see-through.
#[test]
fn what_the_model_has_see_through_is_so_unless_the_view_state_says_otherwise() {
    let mut arrays = SceneArrays::flat(&[0.0, 1.0, 2.0].map(|x| square(x, -10.0, 0.5)));
    arrays.see_through = [1].into_iter().collect();
    let scene = Scene::from_arrays(arrays).unwrap();
    let hidden = ViewState { hidden: [0].into_iter().collect(), ..state(1.0) };
    let solid = ViewState { see_through: Some(ObjectSet::default()), ..hidden.clone() };
    let [modelled, solid] = [hidden, solid].map(|state| CutRule::new(&scene, &state));
    // The root, a mixture, and the objects.
    let codes = |rule: &CutRule| [0, 2, 4, 6].map(|bit| rule.appearance_bits(&scene, 0) >> bit & 3);
    assert_eq!((codes(&modelled), codes(&solid)), ([3, 2, 1, 0], [3, 2, 0, 0]));

    let ids = [0, 1, 2].map(DrawableId);
    let mut see_through = vec![DrawableId(9)];
    assert_eq!(*modelled.divide(&scene, &ids, &mut see_through), [0, 2].map(DrawableId));
    assert_eq!(see_through, [DrawableId(1)]);
    let levels = CutRule::from(state(1.0).lod);
    assert!(matches!(levels.divide(&scene, &ids, &mut see_through), Cow::Borrowed(all) if all == ids));
    assert_eq!(see_through, []);

    assert!(modelled.looks_like(&modelled.clone()) && levels.looks_like(&state(9.0).lod.into()));
    assert!(![&solid, &levels].iter().any(|other| modelled.looks_like(other)), "others look otherwise");
}
