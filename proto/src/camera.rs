//! The camera message: 72 bytes, as in the paper (section 3.3).

use bytes::{Buf, BufMut};
use thiserror::Error;
use trimaran_wire::Fixed;

use crate::{FrameNumber, ViewVersion};

/// A perspective camera, the frame it is for, and the view state of that frame.
///
/// World space is right-handed, in metres. Camera space is right-handed: x right, y up, looking down -z. The
/// projection is reversed-z with an infinite far plane; `near` is in metres. Pixels are square: the aspect
/// ratio is that of the picture, whose size is part of the view state.
///
/// A `Camera` is always valid: its only constructors check. Eye and orientation are `f64` because plants sit
/// at survey coordinates of 10^6 metres and more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    eye: [f64; 3],
    orientation: [f64; 4],
    tan_half_fov_y: f32,
    view: ViewVersion,
    near: f32,
    frame: FrameNumber,
}

/// Why a camera was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CameraError {
    /// The eye has a coordinate that is NaN or infinite.
    #[error("the camera's eye is not finite")]
    Eye,
    /// The orientation is not a unit quaternion (length within 1e-6 of 1).
    #[error("the camera's orientation is not a unit quaternion")]
    Orientation,
    /// The tangent of half the vertical field of view lies outside 1e-5 ..= 1e5 (0.00115 to 179.99885
    /// degrees).
    #[error("the camera's vertical field of view is outside 0.00115 to 179.99885 degrees")]
    FieldOfView,
    /// The near distance is not a finite number above 1e-30 metres.
    #[error("the camera's near distance is not a positive finite number")]
    Near,
}

impl Camera {
    /// The size of a camera on the wire, in bytes.
    pub const SIZE: usize = 72;

    /// A camera at `eye` (metres, world), turned by the unit quaternion `orientation` (x, y, z, w; camera to
    /// world), with the tangent of half its vertical field of view, and its near distance in metres. Its view
    /// state is version 0.
    ///
    /// # Errors
    /// Names the invalid value.
    pub fn new(
        eye: [f64; 3],
        orientation: [f64; 4],
        tan_half_fov_y: f32,
        near: f32,
        frame: FrameNumber,
    ) -> Result<Self, CameraError> {
        if !eye.iter().all(|c| c.is_finite()) {
            return Err(CameraError::Eye);
        }
        let length_squared: f64 = orientation.iter().map(|c| c * c).sum();
        if !(1.0 - 2e-6..=1.0 + 2e-6).contains(&length_squared) {
            return Err(CameraError::Orientation);
        }
        if !(1e-5..=1e5).contains(&tan_half_fov_y) {
            return Err(CameraError::FieldOfView);
        }
        if !(near.is_finite() && near > 1e-30) {
            return Err(CameraError::Near);
        }
        Ok(Self { eye, orientation, tan_half_fov_y, view: ViewVersion(0), near, frame })
    }

    /// A camera at the origin that looks down -z: field of view 90 degrees, near distance 0.1 m.
    #[must_use]
    pub const fn at_origin(frame: FrameNumber) -> Self {
        let orientation = [0.0, 0.0, 0.0, 1.0];
        Self { eye: [0.0; 3], orientation, tan_half_fov_y: 1.0, view: ViewVersion(0), near: 0.1, frame }
    }

    /// The eye in world space, metres.
    #[must_use]
    pub const fn eye(&self) -> [f64; 3] {
        self.eye
    }

    /// The rotation from camera space to world space: a unit quaternion, x, y, z, w.
    #[must_use]
    pub const fn orientation(&self) -> [f64; 4] {
        self.orientation
    }

    /// The tangent of half the vertical field of view.
    #[must_use]
    pub const fn tan_half_fov_y(&self) -> f32 {
        self.tan_half_fov_y
    }

    /// The version of the frame's view state.
    #[must_use]
    pub const fn view(&self) -> ViewVersion {
        self.view
    }

    /// The distance of the near plane, metres.
    #[must_use]
    pub const fn near(&self) -> f32 {
        self.near
    }

    /// The frame this camera is for.
    #[must_use]
    pub const fn frame(&self) -> FrameNumber {
        self.frame
    }

    /// The same pose for another frame.
    #[must_use]
    pub const fn for_frame(self, frame: FrameNumber) -> Self {
        Self { frame, ..self }
    }

    /// The same pose, seen in another view state.
    #[must_use]
    pub const fn in_view(self, view: ViewVersion) -> Self {
        Self { view, ..self }
    }

    /// The 72 bytes on the wire, little-endian: eye 3 x f64, orientation 4 x f64, tan half fov f32, view
    /// version u32, near f32, frame u32.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; Self::SIZE] {
        let mut bytes = [0; Self::SIZE];
        let mut out = bytes.as_mut_slice();
        for number in self.eye.iter().chain(&self.orientation) {
            out.put_f64_le(*number);
        }
        out.put_f32_le(self.tan_half_fov_y);
        out.put_u32_le(self.view.0);
        out.put_f32_le(self.near);
        out.put_u32_le(self.frame.0);
        bytes
    }

    /// Reads a camera from its 72 bytes.
    ///
    /// # Errors
    /// As [`Camera::new`]: bytes of an invalid camera are refused.
    pub fn from_bytes(bytes: &[u8; Self::SIZE]) -> Result<Self, CameraError> {
        let mut bytes = bytes.as_slice();
        let eye = std::array::from_fn(|_| bytes.get_f64_le());
        let orientation = std::array::from_fn(|_| bytes.get_f64_le());
        let (tan_half_fov_y, view) = (bytes.get_f32_le(), ViewVersion(bytes.get_u32_le()));
        let (near, frame) = (bytes.get_f32_le(), FrameNumber(bytes.get_u32_le()));
        Ok(Self::new(eye, orientation, tan_half_fov_y, near, frame)?.in_view(view))
    }
}

impl Fixed for Camera {
    const SIZE: usize = Self::SIZE;
    type Error = CameraError;

    fn write(&self, out: &mut [u8]) {
        if let Some(out) = out.first_chunk_mut() {
            *out = self.to_bytes();
        }
    }

    fn read(bytes: &[u8]) -> Result<Self, CameraError> {
        bytes.first_chunk().map_or(Err(CameraError::Eye), Self::from_bytes)
    }
}
