//! The hard cases of culling, each a small scene and views of it.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, Mat3, Vec3};
use thiserror::Error;
use trimaran_cull::{View, Viewport};
use trimaran_proto::{Camera, CameraError, FrameNumber, SettingsError};
use trimaran_scene::{Scene, SceneError, random::Random};

use super::builder::{Mesh, Object, build};
use super::plant::{plant, plant_views};

/// A scene and a camera path through it, on which culling must lose nothing visible and change no pixel.
#[derive(Debug, Clone)]
pub struct Case {
    /// The difficulty.
    pub name: &'static str,
    /// The scene.
    pub scene: Arc<Scene>,
    /// The camera path.
    pub views: Vec<View>,
}

/// Why a case could not be made: a bug in this module.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaseError {
    /// The scene is malformed.
    #[error("a case's scene is malformed")]
    Scene(#[from] SceneError),
    /// A camera is out of range.
    #[error("a case's camera is out of range")]
    Camera(#[from] CameraError),
    /// A picture's size is out of range.
    #[error("a case's picture size is out of range")]
    Viewport(#[from] SettingsError),
}

/// A view from `eye` towards `target` with the vertical field of view in degrees; the near plane at 0.01 m.
///
/// # Errors
/// If the camera is out of range: `eye` and `target` the same, say.
pub fn looking(
    eye: DVec3,
    target: DVec3,
    fov_degrees: f64,
    viewport: Viewport,
    frame: u32,
) -> Result<View, CameraError> {
    let back = (eye - target).normalize();
    let helper = if back.z.abs() < 0.99 { DVec3::Z } else { DVec3::Y };
    let right = helper.cross(back).normalize();
    let orientation = DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back)).normalize();
    let tan = (fov_degrees.to_radians() * 0.5).tan() as f32;
    let near = 0.01;
    let camera = Camera::new(eye.to_array(), orientation.to_array(), tan, near, FrameNumber(frame))?;
    Ok(View::new(camera, viewport))
}

/// All hard cases.
///
/// # Errors
/// None, unless this module has a bug.
pub fn hard_cases() -> Result<Vec<Case>, CaseError> {
    Ok(vec![
        across_the_near_plane()?,
        eye_inside_a_box()?,
        flat_line_and_point()?,
        still_wall()?,
        slivers_behind_a_gap()?,
        thin_wall_with_something_behind()?,
        scaled_mirrored_sheared()?,
        looking_away()?,
        teleporting()?,
        far_from_the_origin("origin at 0", 0.0)?,
        far_from_the_origin("origin at 1e6", 1e6)?,
        far_from_the_origin("origin at 1e7", 1e7)?,
        far_from_the_origin("origin at 1e8", 1e8)?,
        field_of_view("fov 0.01", 0.01)?,
        field_of_view("fov 1", 1.0)?,
        field_of_view("fov 120", 120.0)?,
        field_of_view("fov 179", 179.0)?,
        picture_size("1 x 1", 1, 1)?,
        picture_size("1 x 97", 1, 97)?,
        picture_size("97 x 1", 97, 1)?,
        picture_size("333 x 777", 333, 777)?,
        picture_size("1023 x 33", 1023, 33)?,
    ])
}

fn small() -> Result<Viewport, SettingsError> {
    Viewport::new(96, 80)
}

fn case(name: &'static str, objects: &[Object], views: Vec<View>) -> Result<Case, CaseError> {
    Ok(Case { name, scene: Arc::new(build(objects, true)?), views })
}

/// Views from the first of the two places that `at` gives for each frame, towards the second.
fn views(frames: u32, fov_degrees: f64, at: impl Fn(f64) -> (DVec3, DVec3)) -> Result<Vec<View>, CaseError> {
    let view = |frame: u32| {
        let (eye, target) = at(f64::from(frame));
        Ok(looking(eye, target, fov_degrees, small()?, frame)?)
    };
    (0..frames).map(view).collect()
}

/// A unit crate at a place.
fn crate_at(x: f64, y: f64, z: f64) -> Object {
    Object::new(Mesh::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 2)).at(DVec3::new(x, y, z))
}

/// A wall across the view along +y: 0.1 m thick, `half` metres to each side.
fn wall(y: f64, half: f32) -> Object {
    let (min, max) = (Vec3::new(-half, 0.0, -half), Vec3::new(half, 0.1, half));
    Object::new(Mesh::cuboid(min, max, 2)).at(DVec3::new(0.0, y, 0.0))
}

fn across_the_near_plane() -> Result<Case, CaseError> {
    let objects =
        [crate_at(0.7, 0.0, 0.0), wall(0.02, 0.3), crate_at(0.0, 3.0, 0.0), crate_at(-0.6, 0.3, 0.0)];
    let at = |frame: f64| (DVec3::new(0.0, -0.05 + frame * 0.002, 0.0), DVec3::new(0.3, 1.0, 0.1));
    case("box across the near plane", &objects, views(40, 70.0, at)?)
}

fn eye_inside_a_box() -> Result<Case, CaseError> {
    // A big crate around the eye with a wall close in front of it, and things inside and outside of the
    // crate.
    let big = Object::new(Mesh::cuboid(Vec3::splat(-4.0), Vec3::splat(4.0), 2));
    let objects =
        [big, wall(0.3, 0.2), crate_at(2.0, 2.0, 0.0), crate_at(0.0, 8.0, 0.0), crate_at(0.0, 1.5, 0.0)];
    let at = |frame: f64| {
        let angle = frame * 0.26;
        (DVec3::new(0.01, 0.02, 0.03), DVec3::new(angle.sin(), angle.cos(), 0.1))
    };
    case("eye inside a box", &objects, views(24, 80.0, at)?)
}

fn flat_line_and_point() -> Result<Case, CaseError> {
    let flat = Mesh::rectangle(Vec3::ZERO, Vec3::X * 0.4, Vec3::Y * 0.3, 1);
    let line = Mesh::rectangle(Vec3::ZERO, Vec3::X * 0.4, Vec3::ZERO, 1);
    let point = Mesh::rectangle(Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, 1);
    let mut random = Random::new(3);
    let objects: Vec<Object> = (0..60)
        .map(|index| {
            let mesh = [&flat, &line, &point][index % 3].clone();
            let place = random.point(DVec3::new(-2.0, 3.0, -2.0), DVec3::new(2.0, 7.0, 2.0));
            Object::new(mesh).at(place).turned(Mat3::from_quat(random.rotation().as_quat()))
        })
        .chain([wall(5.0, 0.8)])
        .collect();
    let at = |frame: f64| (DVec3::new(frame * 0.05 - 0.7, 0.0, 0.2), DVec3::new(0.0, 5.0, 0.0));
    case("flat, line and point boxes", &objects, views(30, 50.0, at)?)
}

fn still_wall() -> Result<Case, CaseError> {
    // A flat wall is its own box: it is tested against its own surface. Far from the origin of its frame, to
    // make it harder.
    let flat = Mesh::rectangle(Vec3::new(300.0, 0.0, 0.0), Vec3::X * 3.0, Vec3::Z * 3.0, 3);
    let turn = Mat3::from_rotation_z(0.3);
    let place = DVec3::new(0.0, 5.0, 0.0) - turn.as_dmat3() * DVec3::new(300.0, 0.0, 0.0);
    let objects =
        [Object::new(flat).at(place).turned(turn), crate_at(1.0, 9.0, 0.0), crate_at(3.5, 5.0, 0.0)];
    let view = looking(DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.3, 5.0, 0.1), 60.0, small()?, 0)?;
    case("wall against its own surface, 200 still frames", &objects, vec![view; 200])
}

fn slivers_behind_a_gap() -> Result<Case, CaseError> {
    // Slivers far away, most of them smaller than a pixel, seen past two walls with a gap of about a pixel.
    let mut random = Random::new(7);
    let mut objects: Vec<Object> = (0..150)
        .map(|_| {
            let half = Vec3::new(random.between(0.001, 0.4) as f32, 0.002, 0.003);
            let place = random.point(DVec3::new(-6.0, 20.0, -6.0), DVec3::new(6.0, 40.0, 6.0));
            Object::new(Mesh::cuboid(-half, half, 1))
                .at(place)
                .turned(Mat3::from_quat(random.rotation().as_quat()))
        })
        .collect();
    let panel = Mesh::cuboid(Vec3::new(-2.0, 0.0, -2.0), Vec3::new(0.0, 0.1, 2.0), 1);
    objects.push(Object::new(panel.clone()).at(DVec3::new(-0.03, 6.0, 0.0)));
    objects.push(Object::new(panel).at(DVec3::new(2.03, 6.0, 0.0)));
    let at = |frame: f64| (DVec3::new(frame * 0.004 - 0.08, 0.0, 0.0), DVec3::new(0.0, 6.0, 0.0));
    case("sub-pixel boxes and slivers past a one-pixel gap", &objects, views(40, 60.0, at)?)
}

fn thin_wall_with_something_behind() -> Result<Case, CaseError> {
    let thin = Mesh::cuboid(Vec3::new(-3.0, 0.0, -3.0), Vec3::new(3.0, 1e-4, 3.0), 2);
    let touching = crate_at(0.0, 4.0 + 1e-4 + 0.5, 0.0);
    let before = crate_at(1.0, 4.0 - 0.5, 1.0);
    let objects = [Object::new(thin).at(DVec3::new(0.0, 4.0, 0.0)), touching, before];
    let at = |frame: f64| (DVec3::new(frame * 0.2 - 3.0, -1.0, 0.1), DVec3::new(0.0, 4.0, 0.0));
    case("thin wall with a crate touching it from behind", &objects, views(30, 60.0, at)?)
}

fn scaled_mirrored_sheared() -> Result<Case, CaseError> {
    let shear = Mat3::from_cols(Vec3::X, Vec3::new(0.8, 1.0, 0.0), Vec3::new(0.3, -0.5, 1.0));
    let flat_shear = Mat3::from_cols(Vec3::X, Vec3::new(1.0, 1e-4, 0.0), Vec3::Z);
    let linears = [
        Mat3::from_diagonal(Vec3::new(1e-3, 1.0, 1e3)),
        Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 1.0)),
        Mat3::from_diagonal(Vec3::new(1e3, 1e-3, -1.0)),
        Mat3::from_diagonal(Vec3::splat(1e-3)),
        shear,
        flat_shear,
        Mat3::from_diagonal(Vec3::new(1.0, 0.0, 1.0)),
    ];
    let mut random = Random::new(11);
    let objects: Vec<Object> = (0..70)
        .map(|index| {
            let place = random.point(DVec3::new(-3.0, 3.0, -3.0), DVec3::new(3.0, 12.0, 3.0));
            Object::new(Mesh::cylinder(0.5, 0.5, 8))
                .at(place)
                .turned(linears[index % linears.len()])
                .with_box_level()
        })
        .chain([wall(6.0, 1.0)])
        .collect();
    let at = |frame: f64| {
        let angle = frame * 0.15;
        (DVec3::new(5.0 * angle.sin(), 5.0 - 6.0 * angle.cos(), 0.4), DVec3::new(0.0, 6.0, 0.0))
    };
    case("scaled by 1e-3 to 1e3, mirrored, sheared", &objects, views(40, 60.0, at)?)
}

fn looking_away() -> Result<Case, CaseError> {
    let objects = [crate_at(0.0, 5.0, 0.0), wall(8.0, 2.0)];
    let away = looking(DVec3::ZERO, DVec3::NEG_Y, 60.0, small()?, 0)?;
    let towards = looking(DVec3::ZERO, DVec3::Y, 60.0, small()?, 0)?;
    case("nothing visible, and back", &objects, vec![towards, away, away, towards, away, towards])
}

/// Every frame from another place in the plant: the last frame's visible set is never useful.
fn teleporting() -> Result<Case, CaseError> {
    let views = plant_views(9, 120, DVec3::ZERO, small()?, 60)?;
    // Views change place every 13, so steps of 17 never stay in the same stretch.
    let views = (0..30).filter_map(|frame| views.get(frame * 17 % 60).copied()).collect();
    Ok(Case { name: "teleport every frame", scene: plant(9, 120, DVec3::ZERO)?, views })
}

fn far_from_the_origin(name: &'static str, distance: f64) -> Result<Case, CaseError> {
    let origin = DVec3::new(distance, -distance, 0.5 * distance);
    Ok(Case { name, scene: plant(5, 120, origin)?, views: plant_views(5, 120, origin, small()?, 30)? })
}

fn field_of_view(name: &'static str, fov_degrees: f64) -> Result<Case, CaseError> {
    let at = |frame: f64| {
        let (angle, eye) = (frame * 0.3, DVec3::new(4.3, 4.4, 1.5));
        (eye, eye + DVec3::new(angle.sin(), angle.cos(), 0.1))
    };
    Ok(Case { name, scene: plant(6, 120, DVec3::ZERO)?, views: views(20, fov_degrees, at)? })
}

fn picture_size(name: &'static str, width: u32, height: u32) -> Result<Case, CaseError> {
    let viewport = Viewport::new(width, height)?;
    Ok(Case {
        name,
        scene: plant(8, 120, DVec3::ZERO)?,
        views: plant_views(8, 120, DVec3::ZERO, viewport, 12)?,
    })
}
