//! Which sides of its triangles a draw shows: of solids seen from outside, the front.
//!
//! That takes nothing from the picture, and saves the device half of a solid's triangles. All passes decide
//! alike, since only the drawable, its node and the view count.

use ash::vk;
use trimaran_cull::View;
use trimaran_scene::{Drawable, Node, Sides};

/// The sides that a draw shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Facing {
    Both,
    Front,
    /// The front of what a node mirrors.
    Mirrored,
}

impl Facing {
    pub(crate) const fn cull_mode(self) -> vk::CullModeFlags {
        match self {
            Self::Both => vk::CullModeFlags::NONE,
            Self::Front => vk::CullModeFlags::BACK,
            Self::Mirrored => vk::CullModeFlags::FRONT,
        }
    }
}

/// Decides it for the draws of a view.
pub(crate) struct Solids {
    view: View,
    /// The squared distance from the eye within which the near plane may cut a solid open, square metres.
    near_squared: f64,
}

/// How much farther than the corners of the near plane a solid must be: more than any rounding.
const CLEARANCE: f64 = 1.01;

impl Solids {
    pub(crate) fn new(view: &View) -> Self {
        let near = CLEARANCE * f64::from(view.camera().near());
        let (x, y) = (view.tan_half_fov_x(), view.tan_half_fov_y());
        Self { view: *view, near_squared: near * near * (1.0 + x * x + y * y) }
    }

    pub(crate) fn facing(&self, drawable: &Drawable, node: &Node) -> Facing {
        if drawable.sides != Sides::FRONT || node.distance_squared(self.view.eye()) <= self.near_squared {
            return Facing::Both;
        }
        match node.linear().as_dmat3().determinant() {
            volume if volume > 0.0 => Facing::Front,
            volume if volume < 0.0 => Facing::Mirrored,
            _ => Facing::Both, // flattened, so that no side is its front
        }
    }
}
