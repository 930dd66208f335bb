//! The viewing direction, and moves relative to it.

use std::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec2, DVec3};

/// The eye never looks straight up or down: there it has no heading.
const STEEPEST: f64 = FRAC_PI_2 - 0.01;

/// A viewing direction. Radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaze {
    /// 0 looks along -z; increases to the left.
    pub heading: f64,
    /// Above the horizon.
    pub pitch: f64,
}

impl Gaze {
    /// Looks along a direction of the world, of any length.
    #[must_use]
    pub fn along(forward: DVec3) -> Self {
        let up = forward.normalize_or_zero().y.clamp(-1.0, 1.0);
        Self { heading: (-forward.x).atan2(-forward.z), pitch: up.asin().clamp(-STEEPEST, STEEPEST) }
    }

    /// Turns to the left, and upwards.
    pub fn turn(&mut self, left: f64, up: f64) {
        self.heading += left;
        self.pitch = (self.pitch + up).clamp(-STEEPEST, STEEPEST);
    }

    /// Camera to world.
    #[must_use]
    pub fn orientation(&self) -> DQuat {
        DQuat::from_rotation_y(self.heading) * DQuat::from_rotation_x(self.pitch)
    }

    /// The viewing direction, a unit vector of the world.
    #[must_use]
    pub fn forward(&self) -> DVec3 {
        self.orientation() * DVec3::NEG_Z
    }

    /// Converts forward and right steps to world x, z.
    #[must_use]
    pub fn on_ground(&self, ahead: f64, right: f64) -> DVec2 {
        let (sin, cos) = self.heading.sin_cos();
        DVec2::new(-sin * ahead + cos * right, -cos * ahead - sin * right)
    }

    /// Turns, and returns the new eye for which `pivot` stays at the same place of the picture.
    #[must_use]
    pub fn turn_about(&mut self, pivot: DVec3, eye: DVec3, left: f64, up: f64) -> DVec3 {
        let seen = self.orientation().inverse() * (eye - pivot);
        self.turn(left, up);
        pivot + self.orientation() * seen
    }

    /// Moves `eye` this many metres to the right and upwards, across the viewing direction.
    #[must_use]
    pub fn pan(&self, eye: DVec3, right: f64, up: f64) -> DVec3 {
        eye + self.orientation() * DVec3::new(right, up, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_gaze_looks_where_it_is_told_and_never_straight_up() {
        let level = Gaze::along(DVec3::new(-3.0, 0.0, 0.0));
        assert!((level.heading - FRAC_PI_2).abs() < 1e-12 && level.pitch == 0.0, "{level:?}");
        assert!((level.on_ground(2.0, 0.0) - DVec2::new(-2.0, 0.0)).length() < 1e-12);
        assert!((level.on_ground(0.0, 1.0) - DVec2::new(0.0, -1.0)).length() < 1e-12);
        assert!((Gaze::along(DVec3::Y).pitch - STEEPEST).abs() < 1e-12);
        assert_eq!(Gaze::along(DVec3::ZERO).pitch, 0.0);
        let mut down = level;
        down.turn(0.0, -9.0);
        assert_eq!(down.pitch, -STEEPEST);
    }

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1e3..1e3).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn a_direction_reads_back(heading in -3.0..3.0, pitch in -1.5..1.5) {
            let gaze = Gaze { heading, pitch };
            let again = Gaze::along(7.0 * gaze.forward());
            prop_assert!((again.heading - heading).abs() < 1e-9 && (again.pitch - pitch).abs() < 1e-9);
        }

        #[test]
        fn a_pivot_stays_where_it_shows(
            pivot in point(), eye in point(), left in -9.0..9.0, up in -9.0..9.0
        ) {
            let mut gaze = Gaze { heading: 0.3, pitch: -0.2 };
            let before = gaze.orientation().inverse() * (pivot - eye);
            let eye = gaze.turn_about(pivot, eye, left, up);
            let after = gaze.orientation().inverse() * (pivot - eye);
            prop_assert!((before - after).length() < 1e-9 * (1.0 + before.length()));
        }
    }
}
