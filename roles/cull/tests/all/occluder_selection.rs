//! Occluders within a budget.

use glam::DVec3;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_cull::{LodRule, TriangleBudget, Viewport, lod_cut, select_occluders, triangles};
use trimaran_proto::DrawableId;
use trimaran_scene::{FlatObject, Scene, SceneArrays};

use crate::pieces::{square, view};

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

/// Squares of these depths, sizes and pairs of triangles, far from the world's origin.
#[test]
fn squares_that_look_large_for_their_triangles_come_first_and_those_too_costly_are_passed_over() {
    let squares = [(10.0, 0.5, 1), (20.0, 2.0, 1), (20.0, 4.0, 8), (5.0, 1.0, 1)];
    let objects = squares.map(|(depth, size, pairs)| {
        let square = square(100.0, -depth, size);
        FlatObject { indices: square.indices.repeat(pairs), ..square }
    });
    let scene = Scene::from_arrays(SceneArrays::flat(&objects)).unwrap();
    for (budget, expected) in [
        (22, vec![0, 1, 2, 3]), // all, as they came
        (21, vec![3, 1, 2]),
        (20, vec![3, 1, 2]),
        (19, vec![3, 1, 0]),
        (5, vec![3, 1]),
        (1, vec![]),
    ] {
        let mut ids: Vec<_> = (0..4).map(DrawableId).collect();
        select_occluders(&scene, &view(100.0, 1.0), &mut ids, TriangleBudget(budget));
        assert_eq!(ids.iter().map(|id| id.0).collect::<Vec<_>>(), expected, "{budget}");
    }
}
