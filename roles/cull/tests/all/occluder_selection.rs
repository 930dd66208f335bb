//! Occluders within a budget.

use glam::DVec3;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_cull::{LodRule, TriangleBudget, Viewport, lod_cut, select_occluders, triangles};
use trimaran_proto::DrawableId;

#[test]
fn a_budget_keeps_what_hides_most_and_a_large_one_all() {
    let viewport = Viewport::new(64, 48).unwrap();
    let scene = plant(1, 200, DVec3::ZERO).unwrap();
    let view = plant_views(1, 200, DVec3::ZERO, viewport, 1).unwrap()[0];
    let cut = lod_cut(&scene, &view, LodRule::new(2.0).unwrap());
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

#[test]
fn who_shows_much_may_draw_more_occluders() {
    let scene = plant(1, 200, DVec3::ZERO).unwrap();
    let shown: Vec<_> = (0..scene.drawables().len() as u32).map(DrawableId).collect();
    let all = triangles(&scene, &shown);
    assert_eq!(TriangleBudget(7).among(&scene, &shown), TriangleBudget(7 + all / 4));
}
