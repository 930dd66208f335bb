//! The sides of triangles that a draw shows: of solids seen from outside, only the front.
//!
//! This does not change the picture, and saves half of a solid's triangles. All roles decide alike, since
//! only the drawable, its node and the view matter.

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
    /// The front of a mirrored node: its corners run clockwise on the screen.
    Mirrored,
}

/// Decides it for the draws of a view. Cut or see-through drawables show both sides anyway.
#[derive(Debug, Clone)]
pub struct Solids {
    view: View,
    /// The squared distance from the eye within which the near plane may cut a solid open, square metres.
    near_squared: f64,
}

/// The required distance of a solid, relative to the near plane's corners: exceeds any rounding.
const CLEARANCE: f64 = 1.01;

impl Solids {
    /// For drawables of `view`.
    #[must_use]
    pub fn new(view: &View) -> Self {
        let near = CLEARANCE * f64::from(view.camera().near());
        let (x, y) = (view.tan_half_fov_x(), view.tan_half_fov_y());
        Self { view: *view, near_squared: near * near * (1.0 + x * x + y * y) }
    }

    /// The sides of `drawable`, whose node and box is [`part`](trimaran_scene::Scene::part).
    #[must_use]
    pub fn facing(&self, drawable: &Drawable, part: &Node) -> Facing {
        let (min, max) = part.world_box();
        let [low, high] = drawable.sides.eyes(min, max);
        let eye = self.view.eye();
        let outside = (low - eye).max(eye - high).max(DVec3::ZERO);
        if outside.length_squared() <= self.near_squared {
            return Facing::Both;
        }
        match part.linear().as_dmat3().determinant() {
            volume if volume > 0.0 => Facing::Front,
            volume if volume < 0.0 => Facing::Mirrored,
            _ => Facing::Both, // flattened, so that no side is its front
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3};
    use trimaran_proto::{Camera, FrameNumber};
    use trimaran_scene::Sides;

    use super::*;
    use crate::Viewport;

    #[test]
    fn a_solid_shows_its_front_to_eyes_that_are_farther_from_its_box_than_the_near_plane_s_corners() {
        let drawable = Drawable {
            error: 0.0,
            node: 0,
            geometry: 0,
            triangles: 1,
            sides: Sides::FRONT,
            piece: 0,
            pieces: 1,
        };
        let shown = |eye: [f64; 3], scale: Vec3| {
            let linear = Mat3::from_diagonal(scale).to_cols_array();
            let part =
                Node { linear, world_min: [4.0, 5.0, 6.0], world_max: [5.0, 7.0, 9.0], ..Node::default() };
            // The corners are 0.173 m away.
            let camera = Camera::new(eye, [0.0, 0.0, 0.0, 1.0], 1.0, 0.1, FrameNumber(0)).unwrap();
            Solids::new(&View::new(camera, Viewport::new(8, 8).unwrap())).facing(&drawable, &part)
        };
        let mirrored = Vec3::new(1.0, -2.0, 1.0);
        for (axis, (low, high)) in [(4.0, 5.0), (5.0, 7.0), (6.0, 9.0)].into_iter().enumerate() {
            for (beyond, sides) in [
                (-0.5, [Facing::Both; 2]),
                (0.17, [Facing::Both; 2]),
                (0.18, [Facing::Front, Facing::Mirrored]),
            ] {
                for place in [low - beyond, high + beyond] {
                    let mut eye = [4.5, 6.0, 7.5];
                    eye[axis] = place;
                    assert_eq!([Vec3::ONE, mirrored].map(|scale| shown(eye, scale)), sides, "{eye:?}");
                    assert_eq!(shown(eye, Vec3::new(1.0, 0.0, 1.0)), Facing::Both, "flattened");
                }
            }
        }
        assert_eq!(shown([0.0; 3], Vec3::new(1.0, 1.0, 0.0)), Facing::Both, "flattened");
    }
}
