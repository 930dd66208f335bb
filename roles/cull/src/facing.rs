//! Which sides of its triangles a draw shows: of solids seen from outside, the front.
//!
//! That takes nothing from the picture, and saves whoever draws half of a solid's triangles. All decide
//! alike, since only the drawable, its node and the view count.

use glam::DVec3;
use trimaran_scene::{Drawable, Node};

use crate::View;

/// The sides that a draw shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Facing {
    /// Both.
    Both,
    /// The front, whose corners run counter-clockwise on the screen.
    Front,
    /// The front of what a node mirrors: its corners run clockwise on the screen.
    Mirrored,
}

/// Decides it for the draws of a view. What is cut open or seen through shows both sides whatever this says.
#[derive(Debug, Clone)]
pub struct Solids {
    view: View,
    /// The squared distance from the eye within which the near plane may cut a solid open, square metres.
    near_squared: f64,
}

/// How much farther than the corners of the near plane a solid must be: more than any rounding.
const CLEARANCE: f64 = 1.01;

impl Solids {
    /// For what is seen from `view`.
    #[must_use]
    pub fn new(view: &View) -> Self {
        let near = CLEARANCE * f64::from(view.camera().near());
        let (x, y) = (view.tan_half_fov_x(), view.tan_half_fov_y());
        Self { view: *view, near_squared: near * near * (1.0 + x * x + y * y) }
    }

    /// The sides of `drawable`, a level of `node`.
    #[must_use]
    pub fn facing(&self, drawable: &Drawable, node: &Node) -> Facing {
        let (min, max) = node.world_box();
        let [low, high] = drawable.sides.eyes(min, max);
        let eye = self.view.eye();
        let outside = (low - eye).max(eye - high).max(DVec3::ZERO);
        if outside.length_squared() <= self.near_squared {
            return Facing::Both;
        }
        match node.linear().as_dmat3().determinant() {
            volume if volume > 0.0 => Facing::Front,
            volume if volume < 0.0 => Facing::Mirrored,
            _ => Facing::Both, // flattened, so that no side is its front
        }
    }
}
