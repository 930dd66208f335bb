//! The seam between the traversal and whatever holds the occluders' depth.

use glam::Vec3;

use crate::View;

/// A box to test against the occluders, in view space: right-handed, x right, y up, looking down -z, metres about the eye.
///
/// It holds all points `centre + a * axes[0] + b * axes[1] + c * axes[2]` with a, b and c from -1 to 1. The traversal has
/// already dilated it (half a pixel and the sub-pixel step), inflated it against depth ties and given it a minimum thickness,
/// and it lies wholly beyond the near plane: a tester rasterizes it as it stands.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TestBox {
    /// The centre.
    pub centre: Vec3,
    /// Half the box's edges.
    pub axes: [Vec3; 3],
}

/// Tells which boxes show in front of (or level with) the occluders' depth.
pub trait BoxTester {
    /// Why a batch could not be tested: a lost device, say.
    type Error: std::error::Error + Send + Sync + 'static;

    /// Tests a batch against the occluders as seen from `view`. Clears `visible` and fills it with one entry a box, in order:
    /// 0 if the box shows at no pixel, else a number above 0. A tester that counts gives the number of pixels at which the box's
    /// front shows; one that does not gives 1.
    ///
    /// # Errors
    /// As the tester says. The traversal stops; nothing is assumed about the boxes.
    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Self::Error>;
}
