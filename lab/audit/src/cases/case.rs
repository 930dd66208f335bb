//! A case, and what cases are made of.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, Vec3};
use thiserror::Error;
use trimaran_cull::{View, Viewport};
use trimaran_proto::{Camera, CameraError, FrameNumber, SettingsError};
use trimaran_scene::{Scene, SceneError};

use super::builder::{Mesh, Object, build};

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
    looking_past(0.01, eye, target, fov_degrees, viewport, frame)
}

/// The same with the near plane at `near` metres.
///
/// # Errors
/// As [`looking`].
pub fn looking_past(
    near: f32,
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
    let camera = Camera::new(eye.to_array(), orientation.to_array(), tan, near, FrameNumber(frame))?;
    Ok(View::new(camera, viewport))
}

pub(super) fn small() -> Result<Viewport, SettingsError> {
    Viewport::new(96, 80)
}

pub(super) fn case(name: &'static str, objects: &[Object], views: Vec<View>) -> Result<Case, CaseError> {
    Ok(Case { name, scene: Arc::new(build(objects, true)?), views })
}

/// Views from the first of the two places that `at` gives for each frame, towards the second.
pub(super) fn views(
    frames: u32,
    fov_degrees: f64,
    at: impl Fn(f64) -> (DVec3, DVec3),
) -> Result<Vec<View>, CaseError> {
    let view = |frame: u32| {
        let (eye, target) = at(f64::from(frame));
        Ok(looking(eye, target, fov_degrees, small()?, frame)?)
    };
    (0..frames).map(view).collect()
}

/// A unit crate at a place.
pub(super) fn crate_at(x: f64, y: f64, z: f64) -> Object {
    Object::new(Mesh::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 2)).at(DVec3::new(x, y, z))
}

/// A wall across the view along +y: 0.1 m thick, `half` metres to each side.
pub(super) fn wall(y: f64, half: f32) -> Object {
    let (min, max) = (Vec3::new(-half, 0.0, -half), Vec3::new(half, 0.1, half));
    Object::new(Mesh::cuboid(min, max, 2)).at(DVec3::new(0.0, y, 0.0))
}
