//! A random plant, and cameras in it.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, Mat3, Quat, Vec3};
use trimaran_cull::{View, Viewport};
use trimaran_proto::{Camera, CameraError, FrameNumber};
use trimaran_scene::{Scene, SceneError, random::Random};

use super::builder::{Mesh, Object, build};
use super::case::{Case, CaseError};

/// Rooms side by side with walls, decks, pipes, vessels and crates in them: about `objects` objects about
/// `origin`, z up, four metres a storey. Walls and decks hide most of it from anywhere inside.
///
/// # Errors
/// None for at least one object.
pub fn plant(seed: u64, objects: usize, origin: DVec3) -> Result<Arc<Scene>, SceneError> {
    plant_in_pieces(seed, objects, origin, MOST)
}

/// The same with levels in pieces of at most `most` triangles.
///
/// # Errors
/// None for at least one object.
pub fn plant_in_pieces(
    seed: u64,
    objects: usize,
    origin: DVec3,
    most: usize,
) -> Result<Arc<Scene>, SceneError> {
    let mut made = objects_of(seed, objects);
    for object in &mut made {
        object.origin += origin;
        object.most = most;
    }
    build(&made, true).map(Arc::new)
}

/// The objects of a plant about the origin.
fn objects_of(seed: u64, objects: usize) -> Vec<Object> {
    let mut random = Random::new(seed);
    let rooms = rooms_across(objects);
    let mut made = Vec::with_capacity(objects);
    for room in 0..rooms * rooms * rooms {
        let corner = room_corner(room, rooms);
        // A deck below, and a wall on one or two sides with a door's gap.
        made.push(slab(corner, DVec3::new(4.0, 4.0, 0.1)));
        if random.between(0.0, 1.0) < 0.85 {
            made.push(slab(corner, DVec3::new(0.1, 3.0, 4.0)));
        }
        if random.between(0.0, 1.0) < 0.85 {
            made.push(slab(corner + DVec3::X, DVec3::new(3.0, 0.1, 4.0)));
        }
        for _ in 0..OBJECTS_IN_A_ROOM {
            made.push(fixture(&mut random, corner));
        }
    }
    made.truncate(objects.max(1));
    made
}

const OBJECTS_IN_A_ROOM: usize = 12;

/// The most triangles of a piece of a level.
const MOST: usize = 16;

/// The rooms per side of a cube of rooms for this many objects.
fn rooms_across(objects: usize) -> usize {
    (1..).find(|n| n * n * n * (OBJECTS_IN_A_ROOM + 3) >= objects).unwrap_or(1)
}

fn room_corner(room: usize, across: usize) -> DVec3 {
    DVec3::new((room % across) as f64, (room / across % across) as f64, (room / across / across) as f64) * 4.0
}

fn slab(corner: DVec3, size: DVec3) -> Object {
    Object::new(Mesh::cuboid(Vec3::ZERO, size.as_vec3(), 2)).at(corner).with_box_level()
}

/// Rounded to 2^-10 metres, so that a plant at 10^8 metres is the same as one at 0, to the last bit.
fn on_grid(point: DVec3) -> DVec3 {
    (point * 1024.0).round() / 1024.0
}

/// A pipe, a vessel or a crate somewhere in the room.
fn fixture(random: &mut Random, corner: DVec3) -> Object {
    let place = corner + on_grid(random.point(DVec3::splat(0.4), DVec3::splat(3.6)));
    let kind = random.between(0.0, 3.0);
    let along = [Mat3::IDENTITY, Mat3::from_rotation_y(1.570_796_4), Mat3::from_rotation_z(1.570_796_4)];
    let turn = along[(random.bits() % 3) as usize];
    if kind < 1.5 {
        let length = random.between(0.3, 2.0) as f32;
        Object::new(Mesh::cylinder(random.between(0.02, 0.15) as f32, length, 10))
            .at(place)
            .turned(turn)
            .with_box_level()
    } else if kind < 2.0 {
        Object::new(Mesh::cylinder(0.4, 0.5, 24)).at(place).turned(turn).with_box_level()
    } else {
        let half = random.point(DVec3::splat(0.05), DVec3::splat(0.35)).as_vec3();
        let turn = Mat3::from_quat(Quat::from_rotation_z(random.between(0.0, 1.5) as f32));
        Object::new(Mesh::cuboid(-half, half, 3)).at(place).turned(turn).with_box_level()
    }
}

/// A camera path of `count` views through a [`plant`] of this many objects: small steps and turns, and a jump
/// every 13 views.
///
/// # Errors
/// None: the cameras are in range.
pub fn plant_views(
    seed: u64,
    objects: usize,
    origin: DVec3,
    viewport: Viewport,
    count: u32,
) -> Result<Vec<View>, CameraError> {
    let usual = PlantCase { origin, viewport, ..PlantCase::default() };
    usual.path(seed, objects, count)
}

/// A plant of 120 objects and a path through it, of which one property is taken to its limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantCase {
    /// Where it is, metres.
    pub origin: DVec3,
    /// How many times as large as usual: the near plane's distance as well.
    pub scale: f64,
    /// The tangent of half the vertical field of view.
    pub tan_half_fov_y: f32,
    /// The picture's size.
    pub viewport: Viewport,
    /// How many frames move, and how many stand still after them.
    pub frames: (u32, u32),
}

impl Default for PlantCase {
    /// 60 degrees high.
    fn default() -> Self {
        Self {
            origin: DVec3::ZERO,
            scale: 1.0,
            tan_half_fov_y: 0.577,
            viewport: Viewport::new(96, 80).unwrap_or(Viewport::LARGEST),
            frames: (10, 8),
        }
    }
}

impl PlantCase {
    const SEED: u64 = 6;
    const OBJECTS: usize = 120;

    /// The scene and the views.
    ///
    /// # Errors
    /// If a camera is out of range, or the scene.
    pub fn case(&self, name: &'static str) -> Result<Case, CaseError> {
        let mut objects = objects_of(Self::SEED, Self::OBJECTS);
        for object in &mut objects {
            object.origin = object.origin * self.scale + self.origin;
            object.linear *= self.scale as f32;
        }
        let (moving, still) = self.frames;
        let mut views = self.path(Self::SEED, Self::OBJECTS, moving)?;
        if let Some(last) = views.last().copied() {
            views.extend((0..still).map(|_| last));
        }
        Ok(Case { name, scene: Arc::new(build(&objects, true)?), views })
    }

    fn path(&self, seed: u64, objects: usize, count: u32) -> Result<Vec<View>, CameraError> {
        let Self { origin, scale, tan_half_fov_y, viewport, .. } = *self;
        let mut random = Random::new(seed);
        let size = 4.0 * rooms_across(objects) as f64;
        let mut eye = DVec3::ZERO;
        let mut heading = 0.0;
        (0..count)
            .map(|frame| {
                if frame % 13 == 0 {
                    eye = random.point(DVec3::splat(0.3), DVec3::splat(size - 0.3));
                    heading = random.between(0.0, std::f64::consts::TAU);
                }
                heading += random.between(-0.15, 0.15);
                let step = DVec3::new(-heading.sin(), heading.cos(), random.between(-0.3, 0.3)) * 0.15;
                eye = (eye + step).clamp(DVec3::splat(0.3), DVec3::splat(size - 0.3));
                // z up: turn the camera's -z to the horizon first.
                let level = DQuat::from_mat3(&DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y));
                let orientation = DQuat::from_rotation_z(heading) * level;
                let camera = Camera::new(
                    (on_grid(eye) * scale + origin).to_array(),
                    orientation.normalize().to_array(),
                    tan_half_fov_y,
                    (0.05 * scale) as f32,
                    FrameNumber(frame),
                )?;
                Ok(View::new(camera, viewport))
            })
            .collect()
    }
}
