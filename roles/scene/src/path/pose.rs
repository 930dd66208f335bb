//! One pose of a camera path: an eye and a viewing direction.

use glam::{DMat3, DQuat, DVec3};
use thiserror::Error;
use trimaran_proto::{Camera, CameraError, FrameNumber};

/// A pose: eye and directions in world space. It always makes a valid camera frame: everything is finite and
/// up is not parallel to forward. Forward and up need not be unit vectors, nor perpendicular; they are kept
/// as given, so that writing a file again reproduces it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    eye: DVec3,
    forward: DVec3,
    up: DVec3,
}

/// Why a pose was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PoseError {
    /// A vector is absent from the file.
    #[error("`{0}` is missing; give three numbers")]
    Missing(&'static str),
    /// A vector has a coordinate that is NaN or infinite.
    #[error("`{0}` is not finite")]
    NotFinite(&'static str),
    /// A direction has no length, or one that underflows or overflows when squared.
    #[error("`{0}` is too short or too long to be a direction; give a unit vector")]
    NoDirection(&'static str),
    /// Up and forward span no plane, so there is no right.
    #[error("`up` is parallel to `forward`; give an `up` at an angle to it")]
    ParallelUp,
}

impl Pose {
    /// Below this sine of the angle between forward and up, the right direction is undefined.
    const LEAST_SINE: f64 = 1e-6;

    /// A pose at `eye` (world, metres), looking along `forward`, with `up` upwards in the picture.
    ///
    /// # Errors
    /// The name of the invalid vector.
    pub fn new(eye: DVec3, forward: DVec3, up: DVec3) -> Result<Self, PoseError> {
        for (name, vector) in [("eye", eye), ("forward", forward), ("up", up)] {
            if !vector.is_finite() {
                return Err(PoseError::NotFinite(name));
            }
        }
        let forward_unit = forward.try_normalize().ok_or(PoseError::NoDirection("forward"))?;
        let up_unit = up.try_normalize().ok_or(PoseError::NoDirection("up"))?;
        if forward_unit.cross(up_unit).length() < Self::LEAST_SINE {
            return Err(PoseError::ParallelUp);
        }
        Ok(Self { eye, forward, up })
    }

    /// The eye in world space, metres.
    #[must_use]
    pub const fn eye(&self) -> DVec3 {
        self.eye
    }

    /// The direction of view, as given: any length.
    #[must_use]
    pub const fn forward(&self) -> DVec3 {
        self.forward
    }

    /// The up direction, as given: any length, not necessarily perpendicular to forward.
    #[must_use]
    pub const fn up(&self) -> DVec3 {
        self.up
    }

    /// The rotation from camera space (x right, y up, looking down -z) to world space: right is forward x up.
    #[must_use]
    pub fn orientation(&self) -> DQuat {
        let back = -self.forward.normalize();
        let right = self.up.normalize().cross(back).normalize();
        DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back)).normalize()
    }

    /// The camera at this pose: `vfov_deg` is the vertical field of view in degrees, `near` the distance of
    /// the near plane in metres.
    ///
    /// # Errors
    /// If field of view or near is out of a camera's range.
    pub fn camera(&self, vfov_deg: f64, near: f32, frame: FrameNumber) -> Result<Camera, CameraError> {
        let tan_half_fov_y = (vfov_deg.to_radians() / 2.0).tan() as f32;
        Camera::new(self.eye.to_array(), self.orientation().to_array(), tan_half_fov_y, near, frame)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn looking_down_minus_z_is_the_identity() {
        let frame = Pose::new(DVec3::ZERO, DVec3::NEG_Z * 7.0, DVec3::Y * 0.1).unwrap();
        assert!(frame.orientation().angle_between(DQuat::IDENTITY) < 1e-12);
    }

    #[test]
    fn camera_takes_over_every_value() {
        let frame = Pose::new(DVec3::new(1e7, 2.0, -3.0), DVec3::X, DVec3::Y).unwrap();
        let camera = frame.camera(60.0, 0.25, FrameNumber(9)).unwrap();
        assert_eq!(camera.eye(), [1e7, 2.0, -3.0]);
        assert!((camera.tan_half_fov_y() - 0.577_350_26).abs() < 1e-6);
        assert_eq!((camera.near(), camera.frame()), (0.25, FrameNumber(9)));
        let right = DQuat::from_array(camera.orientation()) * DVec3::X;
        assert!(right.distance(DVec3::Z) < 1e-12, "right is forward x up: {right}");
    }

    #[test]
    fn a_field_of_view_of_180_degrees_is_no_camera() {
        let frame = Pose::new(DVec3::ZERO, DVec3::X, DVec3::Y).unwrap();
        assert_eq!(frame.camera(180.0, 0.1, FrameNumber(0)), Err(CameraError::FieldOfView));
        assert_eq!(frame.camera(60.0, 0.0, FrameNumber(0)), Err(CameraError::Near));
    }

    #[test]
    fn degenerate_poses_name_the_vector() {
        let nan = DVec3::new(0.0, f64::NAN, 0.0);
        let refused = |eye, forward, up| Pose::new(eye, forward, up).unwrap_err();
        assert_eq!(refused(nan, DVec3::X, DVec3::Y), PoseError::NotFinite("eye"));
        assert_eq!(refused(DVec3::ZERO, DVec3::INFINITY, DVec3::Y), PoseError::NotFinite("forward"));
        assert_eq!(refused(DVec3::ZERO, DVec3::X, nan), PoseError::NotFinite("up"));
        assert_eq!(refused(DVec3::ZERO, DVec3::ZERO, DVec3::Y), PoseError::NoDirection("forward"));
        assert_eq!(refused(DVec3::ZERO, DVec3::X, DVec3::ZERO), PoseError::NoDirection("up"));
        assert_eq!(refused(DVec3::ZERO, DVec3::X, DVec3::X * -4.0), PoseError::ParallelUp);
    }

    proptest! {
        #[test]
        fn orientation_maps_camera_axes_onto_the_pose(
            forward in prop::array::uniform3(-1.0f64..1.0), up in prop::array::uniform3(-1.0f64..1.0)
        ) {
            let (forward, up) = (DVec3::from_array(forward), DVec3::from_array(up));
            prop_assume!(forward.cross(up).length() > 1e-3);
            let turn = Pose::new(DVec3::ZERO, forward, up).unwrap().orientation();
            prop_assert!((turn * DVec3::NEG_Z).distance(forward.normalize()) < 1e-9);
            prop_assert!((turn * DVec3::X).distance(forward.cross(up).normalize()) < 1e-9);
            prop_assert!((turn * DVec3::Y).dot(up) > 0.0);
        }
    }
}
