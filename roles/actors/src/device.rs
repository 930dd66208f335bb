//! What a role needs of its GPU, so that the drivers run on Vulkan or on the f64 reference alike.

use std::time::Duration;

use trimaran_cull::{DepthImage, Image, OcclusionTest, View};
use trimaran_proto::{DrawableId, OcclusionTestKind};

use crate::stop::Stop;

/// The device of a culler: it draws occluders and culls against their depth, which stays on it (paper,
/// section 3.2). As an [`OcclusionTest`] it tests against the occluders finished last.
pub trait CullerDevice: OcclusionTest {
    /// Whether after this error no role can do anything more with the device. Any other error ends the
    /// session that met it, and no other one: see [`RoleError::of_device`](crate::RoleError::of_device).
    fn is_lost(error: &Self::Error) -> bool {
        let _ = error;
        true
    }

    /// Told before the role begins: once `stop` is requested, what waits for the device ends soon, with an
    /// error. A device that never waits long need not look at it.
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// From the next frame on boxes are tested in this way. A device that knows one way only need not look
    /// at it.
    fn change_occlusion_test(&mut self, kind: OcclusionTestKind) {
        let _ = kind;
    }

    /// Starts the occluders of a frame: clears the depth and sets the camera.
    ///
    /// # Errors
    /// As the device says.
    fn begin_occluders(&mut self, view: &View) -> Result<(), Self::Error>;

    /// Draws some more occluders. The result does not depend on their order or grouping.
    ///
    /// # Errors
    /// As the device says.
    fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Self::Error>;

    /// Completes the depth and returns the time in which the device was busy with it. More occluders may be
    /// drawn over it, and it be completed again.
    ///
    /// # Errors
    /// As the device says.
    fn finish_occluders(&mut self) -> Result<Duration, Self::Error>;

    /// Draws some more occluders, and completes the depth.
    ///
    /// # Errors
    /// As the device says.
    fn add_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Self::Error> {
        self.draw_occluders(ids)?;
        self.finish_occluders()?;
        Ok(())
    }

    /// The depth of the occluders finished last. Sessions leave it where it is; an audit looks at it.
    ///
    /// # Errors
    /// As the device says.
    fn read_depth(&mut self) -> Result<DepthImage<'_>, Self::Error>;
}

/// The display's device: it draws what is visible.
pub trait PictureDevice {
    /// Why the device failed.
    type Error: std::error::Error + Send + Sync + 'static;

    /// As [`CullerDevice::cancel_on`].
    fn cancel_on(&mut self, stop: &Stop) {
        let _ = stop;
    }

    /// Draws what is solid and over it what is seen through, each in the order given, to the end.
    ///
    /// # Errors
    /// As the device says.
    fn draw(
        &mut self,
        view: &View,
        solid: &[DrawableId],
        see_through: &[DrawableId],
    ) -> Result<(), Self::Error>;

    /// Reads back the picture drawn last, into `picture`, whose memory is used again.
    ///
    /// # Errors
    /// As the device says.
    fn read(&mut self, picture: &mut Image) -> Result<(), Self::Error>;
}
