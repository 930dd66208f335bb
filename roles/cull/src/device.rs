//! The GPU interface of the roles: they run on Vulkan or on the f64 reference alike.

use std::sync::Arc;
use std::time::Duration;

use trimaran_proto::{DeviceTimes, DrawableId, OcclusionTestKind};

use crate::{CutRule, DepthImage, Image, OcclusionTest, SubPixelGrid, View};

/// The class of a device: equal work costs different times on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceClass {
    /// A driver that draws on the CPU.
    #[default]
    Cpu,
    /// A graphics card.
    Gpu,
}

/// Whether a wait for a device is to end before its work is done.
pub type Cancel = Arc<dyn Fn() -> bool + Send + Sync>;

/// The device of a culler: it draws occluders and culls against their depth, which stays on it (paper,
/// section 3.2). As an [`OcclusionTest`] it tests against the most recently finished occluders.
pub trait CullerDevice: OcclusionTest {
    /// Whether this error makes the device unusable for all roles. Any other error ends only its own session.
    fn is_lost(error: &Self::Error) -> bool {
        let _ = error;
        true
    }

    /// Its class, for estimates of costs.
    fn class(&self) -> DeviceClass {
        DeviceClass::default()
    }

    /// The grid of its rasterizer.
    fn grid(&self) -> SubPixelGrid {
        SubPixelGrid::default()
    }

    /// Called before the role begins: once `cancel` says so, waits for the device end soon, with an error. A
    /// device that never waits long may ignore it.
    fn cancel_on(&mut self, cancel: &Cancel) {
        let _ = cancel;
    }

    /// Uses this occlusion test from the next frame on. A device with only one test may ignore it.
    fn change_occlusion_test(&mut self, kind: OcclusionTestKind) {
        let _ = kind;
    }

    /// Starts the occluders of a frame: clears the depth and sets the camera.
    ///
    /// # Errors
    /// Those of the device.
    fn begin_occluders(&mut self, view: &View) -> Result<(), Self::Error>;

    /// Maps the visible set of an earlier frame to its counterparts in the cut of `view`, as
    /// [`OccluderMapper`](crate::OccluderMapper) does, in any order. By default, and where that is no faster,
    /// it does not. The frame has begun, and nothing is drawn yet.
    ///
    /// # Errors
    /// Those of the device.
    fn map_occluders(
        &mut self,
        view: &View,
        rule: &CutRule,
        ids: &[DrawableId],
    ) -> Result<Option<Vec<DrawableId>>, Self::Error> {
        let _ = (view, rule, ids);
        Ok(None)
    }

    /// Draws some more occluders. The result does not depend on their order or grouping.
    ///
    /// # Errors
    /// Those of the device.
    fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Self::Error>;

    /// Completes the depth. More occluders may be drawn over it afterwards, and it be completed again.
    ///
    /// # Errors
    /// Those of the device.
    fn finish_occluders(&mut self) -> Result<(), Self::Error>;

    /// Completes the depth like [`finish_occluders`](Self::finish_occluders), but need not wait for the
    /// device: the next test does.
    ///
    /// # Errors
    /// Those of the device.
    fn submit_occluders(&mut self) -> Result<(), Self::Error> {
        self.finish_occluders()
    }

    /// Draws some more occluders, and completes the depth.
    ///
    /// # Errors
    /// Those of the device.
    fn add_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Self::Error> {
        self.draw_occluders(ids)?;
        self.submit_occluders()
    }

    /// The device's times since the last call. It does not wait for the device: if work may still be going on
    /// there, all times so far come with a later call, at the latest in the next frame.
    ///
    /// # Errors
    /// Those of the device.
    fn take_times(&mut self) -> Result<DeviceTimes, Self::Error> {
        Ok(DeviceTimes::default())
    }

    /// The depth of the most recently finished occluders, for audits. Sessions leave it on the device.
    ///
    /// # Errors
    /// Those of the device.
    fn read_depth(&mut self) -> Result<DepthImage<'_>, Self::Error>;
}

/// The display's device: it draws the visible drawables.
pub trait PictureDevice {
    /// Why the device failed.
    type Error: std::error::Error + Send + Sync + 'static;

    /// As [`CullerDevice::cancel_on`].
    fn cancel_on(&mut self, cancel: &Cancel) {
        let _ = cancel;
    }

    /// Draws `solid`, then `see_through` over it, each in the given order, and waits for the end. Returns the
    /// device's time, measured by its own timestamps: zero if it has none.
    ///
    /// # Errors
    /// As the device says.
    fn draw(
        &mut self,
        view: &View,
        solid: &[DrawableId],
        see_through: &[DrawableId],
    ) -> Result<Duration, Self::Error>;

    /// Reads the last picture back into `picture`, reusing its memory.
    ///
    /// # Errors
    /// Those of the device.
    fn read(&mut self, picture: &mut Image) -> Result<(), Self::Error>;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NoOccluders, TestBox};

    /// A device with only the required methods. Its error is the name of the step that failed.
    struct Least(Vec<&'static str>);

    #[derive(Debug, PartialEq, thiserror::Error)]
    #[error("{0}")]
    struct Failed(&'static str);

    impl OcclusionTest for Least {
        type Error = Failed;

        fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Failed> {
            NoOccluders.test(view, boxes, visible).unwrap_or_else(|never| match never {});
            Ok(())
        }
    }

    impl CullerDevice for Least {
        fn begin_occluders(&mut self, _: &View) -> Result<(), Failed> {
            Err(Failed("begin"))
        }

        fn draw_occluders(&mut self, ids: &[DrawableId]) -> Result<(), Failed> {
            self.0.push("draw");
            if ids.is_empty() { Err(Failed("draw")) } else { Ok(()) }
        }

        fn finish_occluders(&mut self) -> Result<(), Failed> {
            self.0.push("finish");
            Ok(())
        }

        fn read_depth(&mut self) -> Result<DepthImage<'_>, Failed> {
            Err(Failed("read"))
        }
    }

    #[test]
    fn occluders_of_a_further_round_are_drawn_and_finished_and_no_error_is_taken_lightly() {
        let mut device = Least(Vec::new());
        assert_eq!(device.add_occluders(&[DrawableId(1)]), Ok(()));
        assert_eq!(device.add_occluders(&[]), Err(Failed("draw")));
        assert_eq!(device.0, ["draw", "finish", "draw"]);
        assert!(Least::is_lost(&Failed("draw")));
    }
}
