//! Levels in pieces: each piece is culled by its own box.

use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};
use trimaran_cull::{Culler, LodRule, View, Viewport, lod_cut, occluders};
use trimaran_proto::{Camera, DrawableId, FrameNumber};
use trimaran_scene::{Drawable, FlatObject, Rgba8, Scene, SceneArrays};

use crate::rounds::Device;

const WALL: DrawableId = DrawableId(0);
const LEFT: DrawableId = DrawableId(1);
const RIGHT: DrawableId = DrawableId(2);
const COARSE: DrawableId = DrawableId(3);

/// An upright square, `size` metres from its middle to its edges.
pub(crate) fn square(x: f32, z: f32, size: f32) -> FlatObject {
    let corner = |right: f32, up: f32| Vec3::new(x + size * right, size * up, z);
    FlatObject {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        indices: vec![0, 1, 2, 0, 2, 3],
        colour: Rgba8([200, 150, 100, 255]),
        linear: Mat3::IDENTITY,
        origin: DVec3::ZERO,
    }
}

/// A wall before the left one of two squares. These are the pieces of one object's finest level, which has a
/// coarser one of one piece.
fn scene() -> Arc<Scene> {
    let mut arrays =
        SceneArrays::flat(&[square(-1.0, -5.0, 1.5), square(-2.0, -10.0, 1.0), square(2.0, -10.0, 1.0)]);
    let right = arrays.nodes.pop().unwrap();
    arrays.objects.pop();
    arrays.nodes[0].child_count = 2;
    let both = &mut arrays.nodes[2];
    both.drawable_count = 3;
    (both.local_max[0], both.world_max[0]) = (right.local_max[0], right.world_max[0]);
    let left = arrays.drawables[1];
    arrays.drawables[1] = Drawable { pieces: 2, ..left };
    arrays.drawables[2] = Drawable { node: 2, piece: 1, pieces: 2, ..arrays.drawables[2] };
    arrays.drawables.push(Drawable { error: 0.5, ..left });
    Arc::new(Scene::from_arrays(arrays).unwrap())
}

pub(crate) fn view(x: f64, tan_half_fov: f32) -> View {
    let camera = Camera::new([x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], tan_half_fov, 0.1, FrameNumber(0));
    View::new(camera.unwrap(), Viewport::new(128, 128).unwrap())
}

fn rule(epsilon_px: f64) -> LodRule {
    LodRule::new(epsilon_px).unwrap()
}

#[test]
fn a_hidden_piece_of_a_visible_level_is_not_emitted() {
    let (scene, view) = (scene(), view(0.0, 1.0));
    let mut found = Vec::new();
    let mut culler = Culler::new(Arc::clone(&scene));
    let mut wall = Device::new(&scene, &view, &[WALL]);
    let stats = culler.cull(&view, rule(0.1), &mut wall, |ids| found.extend_from_slice(ids)).unwrap();
    assert_eq!(found, [WALL, RIGHT]);
    let counts = stats.counts;
    assert_eq!((counts.emitted, counts.hidden), (2, 1));
    assert_eq!(counts.visited, counts.outside + counts.hidden + counts.emitted + counts.refined);
    // Without the wall nothing is hidden.
    let mut all = Vec::new();
    culler
        .cull(&view, rule(0.1), &mut Device::new(&scene, &view, &[]), |ids| all.extend_from_slice(ids))
        .unwrap();
    assert_eq!(all, lod_cut(&scene, &view, rule(0.1)));
    assert_eq!(all, [WALL, LEFT, RIGHT]);
}

#[test]
fn a_piece_found_before_the_wall_is_hidden_by_it_later() {
    let (scene, view) = (scene(), view(0.0, 1.0));
    let mut culler = Culler::new(Arc::clone(&scene));
    let mut device = Device::new(&scene, &view, &[]);
    let mut traversal = culler.traverse(&view, rule(0.1), &device).unwrap();
    let mut found = Vec::new();
    while let Some(ids) = traversal.next_level(&mut device).unwrap() {
        found.extend_from_slice(ids);
    }
    device.add(&[WALL]).unwrap();
    traversal.test_again(&mut device, &mut found).unwrap();
    assert_eq!(found, [WALL, RIGHT]);
    let stats = traversal.stats();
    assert_eq!((stats.tested_again, stats.hidden_later), (3, 1));
    assert_eq!((stats.counts.emitted, stats.counts.hidden), (2, 1));
}

#[test]
fn pieces_beside_the_frustum_are_not_of_the_cut() {
    let scene = scene();
    assert_eq!(lod_cut(&scene, &view(2.0, 0.15), rule(0.1)), [RIGHT]);
    assert_eq!(lod_cut(&scene, &view(-2.0, 0.15), rule(0.1)), [WALL, LEFT]);
}

#[test]
fn a_piece_of_the_level_that_is_due_stays_and_anything_else_stands_for_all_pieces() {
    let (scene, view) = (scene(), view(0.0, 1.0));
    let due = |rule: LodRule, ids: &[DrawableId]| occluders(&scene, &view, rule, ids).unwrap();
    let (fine, coarse) = (rule(0.1), rule(1e3));
    assert_eq!(due(fine, &[RIGHT]), [RIGHT]);
    assert_eq!(due(fine, &[RIGHT, WALL, LEFT, RIGHT]), [RIGHT, WALL, LEFT], "each once");
    assert_eq!(due(fine, &[COARSE]), [LEFT, RIGHT]);
    assert_eq!(due(fine, &[COARSE, LEFT]), [LEFT, RIGHT]);
    assert_eq!(due(coarse, &[LEFT, RIGHT]), [COARSE]);
}
