//! Solids, drawn with only their fronts, look the same as with both sides.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, Mat3, Vec3};
use trimaran_cull::{View, Viewport};
use trimaran_proto::{Camera, DrawableId, FrameNumber, Sections};
use trimaran_scene::{FlatObject, Scene, SceneArrays, Sides, random::Random};

use crate::common::{CheckedGpu, NEAR, ids, triangles, view, wall};
use crate::sections::plane;
use crate::three_passes::{NOTHING, Passes};

/// A cube from -1 to 1, its triangles counter-clockwise from outside.
fn cube(linear: Mat3, origin: DVec3) -> FlatObject {
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - 1.0;
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let indices = faces.iter().flat_map(|&[a, b, c, d]| [a, b, c, c, d, a]).collect();
    let positions = (0..8).map(corner).collect();
    FlatObject { positions, indices, linear, origin, ..triangles(&[]) }
}

/// Cubes of all sizes and shapes that reach into each other; every other one is mirrored.
fn heap(random: &mut Random) -> Vec<FlatObject> {
    (0..60)
        .map(|i| {
            let turn = DMat3::from_quat(DQuat::from_axis_angle(random.direction(), random.between(0.0, 3.0)));
            let size = random.point(DVec3::splat(0.05), DVec3::splat(0.6));
            let mirror = DVec3::new(if i % 2 == 0 { 1.0 } else { -1.0 }, 1.0, 1.0);
            let linear = turn * DMat3::from_diagonal(size * mirror);
            cube(linear.as_mat3(), random.point(DVec3::splat(-2.0), DVec3::splat(2.0)))
        })
        .collect()
}

/// The passes over all objects, with these visible sides.
fn passes(gpu: &CheckedGpu, objects: &[FlatObject], sides: Sides) -> Passes {
    let mut arrays = SceneArrays::flat(objects);
    arrays.drawables.iter_mut().for_each(|drawable| drawable.sides = sides);
    Passes::new(gpu, Arc::new(Scene::from_arrays(arrays).unwrap()))
}

/// The number of pixels that show another object. None is lost.
fn differing_pixels(both: &mut Passes, other: &mut Passes, view: &View, all: &[DrawableId]) -> usize {
    let [both, other] = [both.draw(view, all), other.draw(view, all)];
    for (both, other) in both.items.iter().zip(&other.items) {
        assert_eq!(*both == NOTHING, *other == NOTHING, "a pixel is lost, seen from {}", view.eye());
    }
    both.items.iter().zip(&other.items).filter(|(a, b)| a != b).count()
}

#[test]
fn solids_look_the_same_from_anywhere_outside_of_them_and_inside() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let mut random = Random::new(31);
    let objects = heap(&mut random);
    let [mut both, mut front] = [Sides::BOTH, Sides::FRONT].map(|sides| passes(&gpu, &objects, sides));
    let (all, mut pixels, mut differing) = (ids(objects.len()), 0, 0);
    for _ in 0..40 {
        let eye = random.point(DVec3::splat(-3.0), DVec3::splat(3.0));
        let turn = DQuat::from_axis_angle(random.direction(), random.between(0.0, 6.0));
        let camera = Camera::new(eye.to_array(), turn.to_array(), 1.0, NEAR, FrameNumber(0)).unwrap();
        let view = View::new(camera, Viewport::new(200, 150).unwrap());
        pixels += (view.viewport().width() * view.viewport().height()) as usize;
        differing += differing_pixels(&mut both, &mut front, &view, &all);
    }
    // Where the front and the back of a solid meet, rounding decides which is nearer.
    assert!(differing * 2000 < pixels, "{differing} of {pixels} pixels differ");
}

#[test]
fn what_is_open_below_looks_the_same_from_above_and_from_below() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let mut random = Random::new(32);
    // Upright cubes without their lower faces, spaced apart so that nothing else hides their insides.
    let objects: Vec<_> = (0..9)
        .map(|i| {
            let place = DVec3::new(f64::from(i % 3) * 2.0 - 2.0, 0.0, f64::from(i / 3) * 2.0 - 2.0);
            let mut open = cube(Mat3::from_diagonal(Vec3::splat(0.5)), place);
            let corners = |triangle: &[u32; 3]| triangle.map(|corner| open.positions[corner as usize].y);
            let (triangles, _) = open.indices.as_chunks::<3>();
            open.indices = triangles.iter().filter(|t| corners(t) != [-1.0; 3]).flatten().copied().collect();
            open
        })
        .collect();
    let mut arrays = SceneArrays::flat(&objects);
    for drawable in &mut arrays.drawables {
        let (min, max) = arrays.nodes[drawable.node as usize].world_box();
        let high = DVec3::new(f64::INFINITY, max.y, f64::INFINITY);
        drawable.sides = Sides::within(DVec3::NEG_INFINITY, high, min, max);
    }
    let mut open = Passes::new(&gpu, Arc::new(Scene::from_arrays(arrays).unwrap()));
    let mut both = passes(&gpu, &objects, Sides::BOTH);
    let (all, mut pixels, mut differing, mut from_below) = (ids(objects.len()), 0, 0, 0);
    for _ in 0..40 {
        let eye = random.point(DVec3::new(-4.0, -3.0, -4.0), DVec3::new(4.0, 3.0, 4.0));
        let turn = DQuat::from_rotation_arc(DVec3::NEG_Z, -eye.normalize());
        let camera = Camera::new(eye.to_array(), turn.to_array(), 1.0, NEAR, FrameNumber(0)).unwrap();
        let view = View::new(camera, Viewport::new(200, 150).unwrap());
        pixels += (view.viewport().width() * view.viewport().height()) as usize;
        differing += differing_pixels(&mut both, &mut open, &view, &all);
        from_below += usize::from(eye.y < 0.0);
    }
    assert!(differing * 2000 < pixels, "{differing} of {pixels} pixels differ");
    assert!((10..30).contains(&from_below), "{from_below} of 40 eyes are below");
}

#[test]
fn what_faces_away_is_drawn_in_no_pass() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let away = |wall: FlatObject| FlatObject { indices: vec![2, 1, 0, 3, 1, 2], ..wall };
    let wall = wall(Vec3::new(0.0, 0.0, -2.0), 99.0, 99.0);
    // Its outside is still the side towards the eye.
    let mirrored = FlatObject { linear: Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 1.0)), ..wall.clone() };
    let view = view(8, 8, DVec3::ZERO);
    for (object, shows) in
        [(wall.clone(), true), (away(wall), false), (mirrored.clone(), true), (away(mirrored), false)]
    {
        let drawn = passes(&gpu, &[object], Sides::FRONT).draw(&view, &ids(1));
        assert!(drawn.items.iter().all(|item| (*item != NOTHING) == shows));
        assert!(drawn.depth.iter().chain(&drawn.occluders).all(|depth| (*depth > 0.0) == shows));
    }
}

#[test]
fn a_solid_is_drawn_from_both_sides_where_the_eye_is_in_it_or_something_opens_it() {
    let Some(gpu) = CheckedGpu::open() else { return };
    let objects = [cube(Mat3::from_diagonal(Vec3::splat(2.0)), DVec3::ZERO)];
    let [mut both, mut front] = [Sides::BOTH, Sides::FRONT].map(|sides| passes(&gpu, &objects, sides));
    // Inside, and where the near plane cuts a corner off.
    for eye in [DVec3::ZERO, DVec3::new(0.0, 0.0, 2.0 + 0.9 * f64::from(NEAR))] {
        let view = view(24, 24, eye);
        let drawn = front.draw(&view, &ids(1));
        assert!(drawn == both.draw(&view, &ids(1)), "from {eye}");
        assert!(drawn.items.iter().all(|item| *item != NOTHING), "from {eye}");
    }
    // Cut open by a plane.
    let outside = view(24, 24, DVec3::Z * 6.0);
    let cut = outside.with_sections(Sections::new(&[plane(DVec3::Z, DVec3::Z)]).unwrap());
    let drawn = front.draw(&cut, &ids(1));
    assert!(drawn == both.draw(&cut, &ids(1)) && drawn != front.draw(&outside, &ids(1)));
    // See-through.
    let through = |passes: &mut Passes| {
        passes.picture.begin(&outside).unwrap();
        passes.picture.draw_see_through(&ids(1)).unwrap();
        passes.picture.finish().unwrap();
        passes.picture.pixels().unwrap().to_vec()
    };
    let (seen, expected) = (through(&mut front), through(&mut both));
    assert!(seen == expected && seen != front.draw(&outside, &ids(1)).pixels);
}
