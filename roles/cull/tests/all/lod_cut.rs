//! The cut chooses the coarsest level within the bound, and the bound holds.

use glam::{DVec3, Mat3, Vec3};
use proptest::prelude::*;
use trimaran_audit::cases::{Mesh, Object, build, looking};
use trimaran_cull::{Choice, CutRule, LodCut, LodRule, View, Viewport, lod_cut};
use trimaran_proto::{Camera, DrawableId, FrameNumber, Settings, ViewState};
use trimaran_scene::{Level, Node, NodeId, Scene, random::Random};

fn view() -> View {
    looking(DVec3::ZERO, DVec3::Y, 90.0, Viewport::new(100, 100).unwrap(), 0).unwrap()
}

/// One crate of the given half size, its only coarser level 1 m off.
fn crate_scene(half: f32, place: DVec3) -> Scene {
    let mesh = Mesh::cuboid(Vec3::splat(-half), Vec3::splat(half), 1);
    let object = Object { coarser: vec![(1.0, mesh.clone())], ..Object::new(mesh) };
    build(&[object.at(place)], false).unwrap()
}

/// The decision on the root.
fn choose(scene: &Scene, epsilon: f64) -> Choice {
    LodCut::new(scene, &view(), LodRule::new(epsilon).unwrap()).choose(NodeId(0), &scene.nodes()[0])
}

/// The drawables of the chosen level.
fn drawn(choice: Choice) -> Vec<DrawableId> {
    match choice {
        Choice::Draw(level) => level.pieces().collect(),
        choice => panic!("{choice:?}"),
    }
}

#[test]
fn a_rule_needs_a_finite_bound_above_zero() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(LodRule::new(bad).is_err(), "{bad}");
    }
    assert!(LodRule::new(f64::MIN_POSITIVE).is_ok());
}

#[test]
fn the_coarsest_level_within_the_bound_is_chosen() {
    // Focal length 50 px, nearest depth 99 m: 1 m projects to 0.505 px on the axis, a little more with the
    // box's width.
    let scene = crate_scene(1.0, DVec3::new(0.0, 100.0, 0.0));
    assert_eq!(drawn(choose(&scene, 0.506)), [DrawableId(1)]);
    assert_eq!(drawn(choose(&scene, 0.504)), [DrawableId(0)]);
}

#[test]
fn a_leaf_above_the_bound_is_drawn_at_its_finest_level() {
    let scene = crate_scene(1.0, DVec3::new(0.0, 2.0, 0.0));
    assert_eq!(drawn(choose(&scene, 1e-6)), [DrawableId(0)]);
}

#[test]
fn above_the_bound_an_interior_node_is_refined_though_it_has_a_level_and_a_leaf_is_drawn() {
    let half = Vec3::splat(0.5);
    let objects = [-2.0, 2.0].map(|x| Object::new(Mesh::cuboid(-half, half, 1)).at(DVec3::new(x, 20.0, 0.0)));
    let scene = build(&objects, true).unwrap();
    assert_eq!(scene.levels(&scene.nodes()[0]).count(), 1);
    assert_eq!(choose(&scene, 1.0), Choice::Refine);
    assert_eq!(drawn(choose(&scene, 100.0)), [DrawableId(0)]);
    let rule = LodRule::new(1.0).unwrap();
    assert_eq!(lod_cut(&scene, &view(), rule), [DrawableId(1), DrawableId(2)]);
    let childless = Node { child_count: 0, ..scene.nodes()[0] };
    let choice = LodCut::new(&scene, &view(), rule).choose(NodeId(0), &childless);
    assert_eq!(drawn(choice), [DrawableId(0)], "a leaf is drawn");
}

#[test]
fn the_group_that_looks_largest_is_refined() {
    let half = Vec3::splat(0.5);
    // Eight crates near the eye, and eight far off and widely spaced: four groups of four.
    let row = |y: f64| (0..8).map(move |i| DVec3::new(f64::from(i) * 1.5 - 5.25, y, 0.0));
    let objects = row(80.0).chain(row(8.0)).map(|at| Object::new(Mesh::cuboid(-half, half, 1)).at(at));
    let scene = build(&objects.collect::<Vec<_>>(), false).unwrap();
    let view = view();
    let cut = LodCut::new(&scene, &view, LodRule::new(0.01).unwrap());
    assert_eq!(cut.drawables().len(), 16);
    let large = cut.large_drawables(1);
    let distance = |id: &DrawableId| {
        scene.nodes()[scene.drawables()[id.index()].node as usize].distance_squared(view.eye()).sqrt()
    };
    assert_eq!(large.len(), 4);
    assert!(large.iter().all(|id| distance(id) < 10.0), "{large:?}");
}

#[test]
fn what_is_outside_the_frustum_is_not_of_the_cut() {
    // Behind the eye, then beyond each side of a field of view of 90 degrees; then just within each.
    let rule = LodRule::new(1.0).unwrap();
    for (x, y, z, drawn) in [
        (0.0, -9.0, 0.0, 0),
        (13.0, 10.0, 0.0, 0),
        (-13.0, 10.0, 0.0, 0),
        (0.0, 10.0, 13.0, 0),
        (0.0, 10.0, -13.0, 0),
        (10.0, 10.0, 0.0, 1),
        (-10.0, 10.0, 0.0, 1),
        (0.0, 10.0, 10.0, 1),
        (0.0, 10.0, -10.0, 1),
    ] {
        let scene = crate_scene(1.0, DVec3::new(x, y, z));
        assert_eq!(LodCut::new(&scene, &view(), rule).outside(&scene.nodes()[0]), drawn == 0, "{x} {y} {z}");
        assert_eq!(lod_cut(&scene, &view(), rule).len(), drawn, "{x} {y} {z}");
    }
}

/// A short distance at depth z and |p| from the eye projects to at most f |p| / z^2 times itself: off the
/// axis as well, the bound is no more than that.
#[test]
fn the_bound_is_tight_for_a_small_box_anywhere_in_the_frustum() {
    let view = looking(DVec3::ZERO, DVec3::Y, 90.0, Viewport::new(200, 100).unwrap(), 0).unwrap();
    for (across, up) in
        [(0.0, 0.0), (1.9, 0.0), (-1.9, 0.0), (0.0, 0.9), (0.0, -0.9), (1.9, 0.9), (-1.0, -0.5)]
    {
        for depth in [0.5, 10.0, 3000.0] {
            let place = DVec3::new(across, 1.0, up) * depth;
            let scene = crate_scene(1e-3 * depth as f32, place);
            let cut = LodCut::new(&scene, &view, LodRule::new(1.0).unwrap());
            let error = 1e-4 * depth;
            let bound = cut.error_on_screen(&scene.nodes()[0], error);
            let exact = 50.0 * place.length() / (depth * depth) * error;
            assert!(bound >= exact && bound < 1.01 * exact, "{bound}, not {exact}, at {place}");
        }
    }
}

/// The visible part of a wall beside the eye is as far away as the edge of the picture.
#[test]
fn the_bound_of_a_box_beside_the_frustum_is_that_of_its_part_in_the_frustum() {
    let wall = Mesh::cuboid(Vec3::new(30.0, 1.0, -1.0), Vec3::new(31.0, 300.0, 1.0), 1);
    for turn in [0.0, 0.5, 1.0, 1.5].map(|turns: f32| Mat3::from_rotation_y(turns * std::f32::consts::PI)) {
        let scene = build(&[Object::new(wall.clone()).turned(turn)], false).unwrap();
        let cut = LodCut::new(&scene, &view(), LodRule::new(1.0).unwrap());
        // The eye is 30 m away, and no direction in the picture is more than sqrt(3) longer than it is deep.
        let (spread, error) = (3.0_f64.sqrt(), 0.01);
        let depth = (30.0_f64.powi(2) + 1.0).sqrt() / spread - error;
        let expected = 50.0 * spread * error / depth;
        let bound = cut.error_on_screen(&scene.nodes()[0], error);
        assert!((bound / expected - 1.0).abs() < 1e-5, "{bound}, not {expected}");
    }
}

#[test]
fn the_error_is_infinite_at_the_near_plane_and_around_the_eye() {
    for y in [0.0, 0.5, 1.005] {
        let scene = crate_scene(1.0, DVec3::new(0.0, y, 0.0));
        let cut = LodCut::new(&scene, &view(), LodRule::new(1.0).unwrap());
        assert_eq!(cut.error_on_screen(&scene.nodes()[0], 0.1), f64::INFINITY, "{y}");
        assert_eq!(cut.error_on_screen(&scene.nodes()[0], 0.0), 0.0, "{y}");
    }
    // A box from the near plane on, exactly, and one just beyond.
    let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 1.0, 0.5, FrameNumber(0)).unwrap();
    let view = View::new(camera, Viewport::new(100, 100).unwrap());
    let scene = crate_scene(1.0, DVec3::ZERO);
    let cut = LodCut::new(&scene, &view, LodRule::new(1.0).unwrap());
    for (front, is_finite) in [(-0.5, false), (-0.501, true)] {
        let (world_min, world_max) = ([-1.0, -1.0, front - 2.0], [1.0, 1.0, front]);
        let node = Node { world_min, world_max, ..scene.nodes()[0] };
        assert_eq!(cut.error_on_screen(&node, 0.1).is_finite(), is_finite, "{front}");
    }
}

#[test]
fn a_box_that_is_not_finite_is_refined() {
    let scene = crate_scene(1.0, DVec3::new(0.0, 50.0, 0.0));
    let cut = LodCut::new(&scene, &view(), LodRule::new(1e9).unwrap());
    for bad in [f64::NAN, f64::INFINITY] {
        for axis in 0..3 {
            let mut node = scene.nodes()[0];
            node.world_max[axis] = bad;
            assert_eq!(cut.error_on_screen(&node, 1e-9), f64::INFINITY, "{bad} {axis}");
            assert!(!cut.outside(&node), "{bad} {axis}");
        }
    }
}

/// Any machine must compute exactly these bits.
#[test]
fn the_projected_error_has_golden_bits() {
    let orientation = [0.1, -0.2, 0.3, 0.927_361_849_549_570_4];
    let eye = [1234.5, -678.9, 42.0];
    let camera = Camera::new(eye, orientation, 0.577_350_3, 0.1, FrameNumber(7)).unwrap();
    let view = View::new(camera, Viewport::new(1600, 1000).unwrap());
    let ahead = view.eye() + view.to_view().transpose() * DVec3::new(3.0, -2.0, -40.0);
    let place = (ahead * 64.0).round() / 64.0;
    let scene = crate_scene(1.25, place);
    let cut = LodCut::new(&scene, &view, LodRule::new(1.0).unwrap());
    let bits = cut.error_on_screen(&scene.nodes()[0], 0.037).to_bits();
    assert_eq!(bits, 0x3feb_4833_320c_41fb, "{bits:#x}");
}

proptest! {
    /// No point of the box, displaced within it by the error, moves farther on the screen than the bound.
    #[test]
    fn the_bound_holds(seed: u64, fov in 1.0..170.0_f64, half in 0.01..30.0_f32, error in 0.001..20.0_f64) {
        let mut random = Random::new(seed);
        let place = random.point(DVec3::new(-60.0, -5.0, -60.0), DVec3::new(60.0, 60.0, 60.0));
        let view = looking(DVec3::ZERO, DVec3::Y, fov, Viewport::new(200, 100).unwrap(), 0).unwrap();
        let scene = crate_scene(half, place);
        let node = &scene.nodes()[0];
        let (min, max) = node.world_box();
        let cut = LodCut::new(&scene, &view, LodRule::new(1.0).unwrap());
        let bound = cut.error_on_screen(node, error);
        let near = f64::from(view.camera().near());
        let on_screen = |p: DVec3| {
            let p = view.world_to_view(p);
            let (x, y) = (-p.x / p.z, -p.y / p.z);
            let inside = -p.z > near && x.abs() <= view.tan_half_fov_x() && y.abs() <= view.tan_half_fov_y();
            (inside, -p.z > near, x * view.focal_x(), y * view.focal_y())
        };
        for _ in 0..50 {
            let p = random.point(min, max);
            let q = (p + random.direction() * random.between(0.0, error)).clamp(min, max);
            let (p_inside, _, px, py) = on_screen(p);
            let (_, q_before, qx, qy) = on_screen(q);
            if p_inside && q_before {
                let moved = (px - qx).hypot(py - qy);
                prop_assert!(moved <= bound * (1.0 + 1e-9), "{moved} > {bound}");
            }
        }
    }
}

#[test]
fn what_can_stand_in_is_coarser_within_the_bound_and_of_objects_drawn_alike() {
    let half = Vec3::splat(0.5);
    let objects = [-2.0, 2.0].map(|x| {
        let mesh = Mesh::cuboid(-half, half, 1);
        let coarser = vec![(0.01, mesh.clone()), (0.1, mesh.clone())];
        Object { coarser, ..Object::new(mesh) }.at(DVec3::new(x, 20.0, 0.0))
    });
    let scene = build(&objects, true).unwrap();
    let above: Vec<_> = scene.nodes()[0].drawables().collect();
    let own: Vec<_> = scene.nodes()[1].drawables().collect();
    assert_eq!((above.len(), own.len()), (1, 3));
    let (view, lod) = (view(), LodRule::new(0.001).unwrap());
    let coarser = |rule: CutRule, id, bound_px| -> Vec<_> {
        LodCut::new(&scene, &view, rule).coarser(id, bound_px).map(Level::first).collect()
    };
    assert_eq!(coarser(lod.into(), own[0], 1e9), [own[1], own[2], above[0]]);
    assert_eq!(coarser(lod.into(), own[1], 1e9), [own[2], above[0]]);
    assert_eq!(coarser(lod.into(), above[0], 1e9), []);
    assert_eq!(coarser(lod.into(), DrawableId(99), 1e9), []);
    // A metre projects to about 2.6 px.
    assert_eq!(coarser(lod.into(), own[0], 0.1), [own[1]]);
    assert_eq!(coarser(lod.into(), own[0], 1e-3), []);

    let state = ViewState::from(Settings::new(view.viewport(), lod));
    let hidden = ViewState { hidden: [1].into_iter().collect(), ..state };
    assert_eq!(coarser(CutRule::new(&scene, &hidden), own[0], 1e9), [own[1], own[2]], "one of two is hidden");
}
