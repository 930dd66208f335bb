//! The occlusion test: the interface between the traversal and the holder of the occluders' depth.

use std::convert::Infallible;

use glam::Vec3;

use crate::{CutRule, View, WholeTraversal};

/// A box to test against the occluders, in view space: right-handed, x right, y up, looking down -z, metres
/// about the eye.
///
/// It holds all points `centre + a * axes[0] + b * axes[1] + c * axes[2]` with a, b and c from -1 to 1. The
/// axes are at right angles to each other and none is zero. The traversal has already inflated it against
/// rounding and depth ties, dilated it (unless the test's [`Outline`] says that the test does that) and given
/// it a minimum thickness, and it lies wholly beyond the near plane: an occlusion test rasterizes it as it
/// is.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TestBox {
    /// The centre.
    pub centre: Vec3,
    /// Half the box's edges.
    pub axes: [Vec3; 3],
}

/// Where a box's outline is grown by half a pixel and the sub-pixel step, so that a box smaller than a pixel
/// is not lost between the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Outline {
    /// The traversal grows the box itself, in view space: right for a test that draws boxes. This moves the
    /// faces towards the eye as well, so a box behind a thin wall may count as visible.
    #[default]
    InBox,
    /// The test grows the outline on the screen and leaves the faces where they are: tighter.
    OnScreen,
}

/// The meaning of an occlusion test's answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Answer {
    /// 0 or 1: hidden or visible.
    #[default]
    YesNo,
    /// The number of pixels at which the box's front is visible.
    PixelCount,
}

/// Decides which boxes are in front of (or level with) the occluders' depth.
pub trait OcclusionTest {
    /// Why a batch could not be tested, for instance a lost device.
    type Error: std::error::Error + Send + Sync + 'static;

    /// Tests a batch against the occluders in `view`. Clears `visible` and fills it with one entry per box,
    /// in order: 0 if the box is visible at no pixel, else a number above 0. A counting test gives the number
    /// of pixels at which the box's front is visible; others give 1.
    ///
    /// # Errors
    /// Those of the implementation. The traversal stops; nothing is assumed about the boxes.
    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Self::Error>;

    /// Goes through the whole tree at once, if the test can do that for this rule, and decides as a traversal
    /// that asks box by box. By default it cannot.
    ///
    /// # Errors
    /// Those of the implementation.
    fn traverse(&mut self, view: &View, rule: &CutRule) -> Result<Option<WholeTraversal>, Self::Error> {
        let _ = (view, rule);
        Ok(None)
    }

    /// Whether each traversal of its own is to be compared with one that asks box by box.
    fn is_checked(&self) -> bool {
        false
    }

    /// Whether this test grows outlines by itself.
    fn outline(&self) -> Outline {
        Outline::default()
    }

    /// Whether this test counts pixels.
    fn answer(&self) -> Answer {
        Answer::default()
    }
}

/// A test without occluders: every box is visible. For the first frame, and for the unculled cut.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoOccluders;

impl OcclusionTest for NoOccluders {
    type Error = Infallible;

    fn test(&mut self, _: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
        visible.clear();
        visible.resize(boxes.len(), 1);
        Ok(())
    }
}
