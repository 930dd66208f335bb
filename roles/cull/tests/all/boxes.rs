//! Boxes contain their nodes' geometry, and are visible wherever it is.

use glam::{DVec3, Mat3, Vec3};
use trimaran_audit::cases::{Mesh, Object, build, looking};
use trimaran_audit::{IdBuffer, ReferenceTest};
use trimaran_cull::{
    BoxMaker, DepthImage, DepthPyramid, HzbTest, OcclusionTest, Outline, Prepared, Untestable, View, Viewport,
};
use trimaran_scene::{Node, Scene, random::Random};

fn scene_of(object: Object) -> Scene {
    build(&[object], false).unwrap()
}

fn view() -> View {
    looking(DVec3::ZERO, DVec3::Y, 60.0, Viewport::new(64, 48).unwrap(), 0).unwrap()
}

fn prepare(object: Object, view: &View, outline: Outline) -> Prepared {
    let scene = scene_of(object);
    BoxMaker::new(view, outline).prepare(&scene.nodes()[0])
}

fn cuboid(half: Vec3) -> Object {
    Object::new(Mesh::cuboid(-half, half, 1))
}

#[test]
fn a_box_around_the_eye_across_the_near_plane_or_behind_the_eye_needs_no_test() {
    for (place, expected) in [
        (DVec3::ZERO, Prepared::Visible(Untestable::EyeInside)),
        (DVec3::new(1.05, 0.5, 0.0), Prepared::Visible(Untestable::AcrossNear)),
        (DVec3::new(0.0, -1.5, 0.0), Prepared::Outside),
    ] {
        assert_eq!(prepare(cuboid(Vec3::ONE).at(place), &view(), Outline::InBox), expected, "{place}");
    }
}

#[test]
fn a_box_that_is_not_finite_is_visible() {
    let scene = scene_of(cuboid(Vec3::ONE).at(DVec3::new(0.0, 5.0, 0.0)));
    let maker = BoxMaker::new(&view(), Outline::InBox);
    let visible = Prepared::Visible(Untestable::NotFinite);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut node = scene.nodes()[0];
        node.local_max[1] = bad;
        assert_eq!(maker.prepare(&node), visible, "corner {bad}");
        let mut node = scene.nodes()[0];
        node.linear[4] = bad;
        assert_eq!(maker.prepare(&node), visible, "matrix {bad}");
        let mut node = scene.nodes()[0];
        node.origin[0] = f64::from(bad);
        assert_eq!(maker.prepare(&node), visible, "origin {bad}");
        let far = Node { reach: bad.abs(), ..scene.nodes()[0] };
        assert_eq!(maker.prepare(&far), visible, "reach {bad}");
    }
    let mut node = scene.nodes()[0];
    node.linear = [f32::MAX; 9];
    assert_eq!(maker.prepare(&node), visible, "too large for f32");
    let far = Node { origin: [0.0, 1e39, 0.0], ..scene.nodes()[0] };
    assert_eq!(maker.prepare(&far), visible, "too far for f32");
}

/// Cubes, flats, lines and points from far below a pixel to several, anywhere in the picture: before an empty
/// background both occlusion tests show every one of them.
#[test]
fn boxes_of_any_size_and_shape_show_when_nothing_is_before_them() {
    let view = view();
    let background = IdBuffer::new(view.viewport());
    let depth = background.depth32();
    let image = DepthImage::new(view.viewport(), &depth).unwrap();
    let pyramid = DepthPyramid::over(image);
    let mut random = Random::new(1);
    let mut answers = Vec::new();
    for index in 0..4000 {
        let y = random.between(2.0, 200.0);
        // Wholly within the picture, so that the edge of the frustum does not matter.
        let place = DVec3::new(random.between(-0.5, 0.5) * y, y, random.between(-0.35, 0.35) * y);
        let size = 0.05 * y * random.between(-12.0, 0.0).exp2();
        let half =
            [DVec3::ONE, DVec3::new(1.0, 1.0, 0.0), DVec3::X, DVec3::ZERO, DVec3::new(1.0, 1e-3, 1e-3)]
                [index % 5]
                * size;
        let linear = Mat3::from_quat(random.rotation().as_quat());
        let object = || cuboid(half.as_vec3()).at(place).turned(linear);
        let (Prepared::Test(in_box), Prepared::Test(on_screen)) =
            (prepare(object(), &view, Outline::InBox), prepare(object(), &view, Outline::OnScreen))
        else {
            panic!("{place} {half} is testable");
        };
        assert!(ReferenceTest::new(&background).count(&view, &in_box) > 0, "{place} {half}");
        let mut test = HzbTest::new(image, &pyramid).unwrap();
        test.test(&view, &[on_screen], &mut answers).unwrap();
        assert_eq!(answers, [1], "{place} {half}");
    }
}

/// The box contains every vertex as f32 arithmetic places it; sheared, mirrored, scaled and far from its
/// origin.
#[test]
fn boxes_hold_their_vertices_as_a_gpu_places_them() {
    let mut random = Random::new(2);
    let mut held = 0;
    for _ in 0..2000 {
        let linear = Mat3::from_cols(
            (random.direction() * random.between(-9.0, 9.0).exp2()).as_vec3(),
            (random.direction() * random.between(-9.0, 9.0).exp2()).as_vec3(),
            (random.direction() * random.between(-9.0, 9.0).exp2()).as_vec3(),
        );
        let corner = random.point(DVec3::splat(-300.0), DVec3::splat(300.0)).as_vec3();
        let object = Object::new(Mesh::cuboid(corner, corner + Vec3::new(1.0, 0.3, 0.0), 1));
        let eye = random.point(DVec3::splat(-1e7), DVec3::splat(1e7));
        let target = eye + random.direction() * 50.0;
        let view = looking(eye, target, 60.0, Viewport::new(64, 48).unwrap(), 0).unwrap();
        let origin = target - linear.as_dmat3() * corner.as_dvec3();
        let scene = scene_of(object.at(origin).turned(linear));
        let node = &scene.nodes()[0];
        let Prepared::Test(test_box) = BoxMaker::new(&view, Outline::OnScreen).prepare(node) else {
            continue;
        };
        let single = (view.to_view() * linear.as_dmat3()).as_mat3();
        let offset = (view.to_view() * (node.origin() - view.eye())).as_vec3();
        for vertex in scene.geometry(0).unwrap().vertices {
            let placed = (single * Vec3::from_array(vertex.position) + offset).as_dvec3();
            for axis in test_box.axes.map(Vec3::as_dvec3) {
                let along = axis.dot(placed - test_box.centre.as_dvec3()).abs() / axis.length_squared();
                assert!(along <= 1.0, "{along}: {test_box:?} {placed}");
                held += 1;
            }
        }
    }
    assert!(held > 10_000, "{held}");
}

#[test]
fn a_reach_goes_up_to_the_root() {
    let far = Mesh::cuboid(Vec3::new(499.0, 0.0, 0.0), Vec3::new(500.0, 0.0, 0.0), 1);
    let scene = build(&[Object::new(far).at(DVec3::X * -500.0), cuboid(Vec3::ONE)], false).unwrap();
    let reach: Vec<f32> = scene.nodes().iter().map(|node| node.reach).collect();
    assert!(reach[0] >= 500.0 && reach[0] < 500.1, "{reach:?}");
    assert_eq!(reach.iter().filter(|&&r| r < 2.0).count(), 1, "{reach:?}");
}
