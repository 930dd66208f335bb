//! Occluders within a budget.

#![allow(clippy::unwrap_used, reason = "a test or benchmark that cannot be set up fails")]

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::DVec3;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_cull::{LodRule, TriangleBudget, View, Viewport, lod_cut, nearest_occluders, select_occluders};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

fn case(views: u32) -> (Arc<Scene>, Vec<View>, LodRule) {
    let viewport = Viewport::new(64, 48).unwrap();
    let scene = plant(1, 200, DVec3::ZERO).unwrap();
    let views = plant_views(1, 200, DVec3::ZERO, viewport, views).unwrap();
    (scene, views, LodRule::new(2.0).unwrap())
}

fn triangles(scene: &Scene, ids: &[DrawableId]) -> u64 {
    ids.iter().map(|id| u64::from(scene.drawables()[id.index()].index_count / 3)).sum()
}

#[test]
fn the_nearest_are_a_prefix_of_the_cut_front_to_back() {
    let (scene, views, rule) = case(5);
    for view in views {
        let mut cut = lod_cut(&scene, &view, rule);
        let all = triangles(&scene, &cut);
        let distance = |id: &DrawableId| {
            let node = &scene.nodes()[scene.drawables()[id.index()].node as usize];
            let (min, max) = node.world_box();
            (min - view.eye()).max(view.eye() - max).max(DVec3::ZERO).length_squared()
        };
        cut.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        for budget in [0, all / 3, all] {
            let mut near = Vec::new();
            nearest_occluders(&scene, &view, rule, TriangleBudget(budget), &mut near);
            assert!(triangles(&scene, &near) <= budget);
            let expected: Vec<f64> = cut.iter().take(near.len()).map(distance).collect();
            assert_eq!(near.iter().map(distance).collect::<Vec<_>>(), expected);
        }
        let mut near = Vec::new();
        nearest_occluders(&scene, &view, rule, TriangleBudget(all), &mut near);
        assert_eq!(near.into_iter().collect::<BTreeSet<_>>(), cut.into_iter().collect());
    }
}

#[test]
fn a_budget_keeps_what_hides_most_and_a_large_one_all() {
    let (scene, views, rule) = case(1);
    let view = views[0];
    let cut = lod_cut(&scene, &view, rule);
    let all = triangles(&scene, &cut);
    let mut kept = cut.clone();
    select_occluders(&scene, &view, &mut kept, TriangleBudget(all));
    assert_eq!(kept, cut, "nothing to choose");
    select_occluders(&scene, &view, &mut kept, TriangleBudget(all / 4));
    assert!(triangles(&scene, &kept) <= all / 4 && !kept.is_empty());
    kept.push(DrawableId(u32::MAX));
    select_occluders(&scene, &view, &mut kept, TriangleBudget(0));
    assert_eq!(kept, []);
}
