//! A person's pose, and how input changes it.

use std::time::Duration;

use glam::{DVec2, DVec3};

use super::{gaze::Gaze, ground::Solid, keys::Motion, prediction::Pose, walk::Walk};

/// How a person moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// On the ground.
    Walk,
    /// Freely through everything.
    Fly,
    /// Around the point under the pointer.
    Orbit,
}

impl Mode {
    /// The name of the mode, as a verb.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Walk => "walking",
            Self::Fly => "flying",
            Self::Orbit => "orbiting",
        }
    }
}

/// How fast the eye turns with the keys, radians a second.
const TURN: f64 = 1.6;
/// Radians a pixel of the mouse, for looking around and for orbiting.
const LOOK: f64 = 0.003;
const ORBIT: f64 = 0.006;
/// Pixels of a drag that move a walking person by the height of the eye.
const PUSH: f64 = 150.0;
/// The share of the distance that a wheel step covers.
const DOLLY: f64 = 0.15;
/// The longest time step: the eye does not jump after a pause in drawing.
const LONGEST: Duration = Duration::from_millis(100);
/// Running speed factor.
const FASTER: f64 = 4.0;
/// Metres a second, of a person whose eye is at 1.7 m.
const STROLL: f64 = 1.4 / 1.7;
/// Vertical fields of view, degrees.
const NARROWEST: f64 = 20.0;
const WIDEST: f64 = 100.0;

/// Where a person begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Metres in the world.
    pub eye: DVec3,
    /// The viewing direction, of any length.
    pub forward: DVec3,
    /// Height of the eye above floors, which sets the scale of the scene.
    pub eye_height: f64,
    /// Whether there are floors to walk on.
    pub has_floors: bool,
    /// Vertical field of view, degrees.
    pub vfov_deg: f64,
}

/// A drag of the pointer, in logical pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drag {
    /// To the right.
    pub right: f64,
    /// Downwards.
    pub down: f64,
    /// Pans instead of orbiting.
    pub is_pan: bool,
}

/// A person's pose, and the state of its motion.
#[derive(Debug)]
pub struct Navigator {
    eye: DVec3,
    gaze: Gaze,
    walk: Walk,
    mode: Mode,
    scale: f64,
    vfov_deg: f64,
    /// Metres a second.
    speed: f64,
    /// The point to orbit and to approach.
    pivot: Option<DVec3>,
    /// How far a drag has moved the person since the last step: forward and right, metres.
    pushed: DVec2,
    /// Whether the eye was moved since the last step.
    has_moved: bool,
}

impl Navigator {
    /// A person at the start; walks if there are floors.
    #[must_use]
    pub fn new(start: &Start) -> Self {
        let Start { eye, forward, eye_height, has_floors, vfov_deg } = *start;
        Self {
            eye,
            gaze: Gaze::along(forward),
            walk: Walk::new(eye, eye_height),
            mode: if has_floors { Mode::Walk } else { Mode::Fly },
            scale: eye_height,
            vfov_deg,
            speed: STROLL * eye_height,
            pivot: None,
            pushed: DVec2::ZERO,
            has_moved: true,
        }
    }

    /// The eye and the viewing direction.
    #[must_use]
    pub const fn pose(&self) -> Pose {
        Pose { eye: self.eye, gaze: self.gaze }
    }

    /// How the person moves.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// Vertical field of view, degrees.
    #[must_use]
    pub const fn vfov_deg(&self) -> f64 {
        self.vfov_deg
    }

    /// Metres a second.
    #[must_use]
    pub const fn speed(&self) -> f64 {
        self.speed
    }

    /// Switches to this mode.
    pub fn set_mode(&mut self, mode: Mode) {
        self.mode = mode;
        self.walk.place(self.eye);
        self.has_moved = true;
    }

    /// Sets the vertical field of view, degrees, within limits.
    pub fn set_vfov(&mut self, degrees: f64) {
        self.vfov_deg = degrees.clamp(NARROWEST, WIDEST);
        self.has_moved = true;
    }

    /// Puts the eye at a place, looking along `forward`.
    pub fn go_to(&mut self, eye: DVec3, forward: DVec3) {
        (self.eye, self.gaze, self.has_moved) = (eye, Gaze::along(forward), true);
        self.walk.place(eye);
    }

    /// Moves for this long. Returns whether the eye has moved since the last step.
    pub fn step(&mut self, time: Duration, motion: Motion, is_fast: bool, solid: &impl Solid) -> bool {
        let seconds = time.min(LONGEST).as_secs_f64();
        if motion.turn != 0.0 || motion.tilt != 0.0 {
            self.gaze.turn(TURN * seconds * motion.turn, TURN * seconds * motion.tilt);
            self.has_moved = true;
        }
        let way = self.speed * seconds * if is_fast { FASTER } else { 1.0 };
        let before = self.eye;
        if self.mode == Mode::Walk {
            if motion.up > 0.0 {
                self.walk.jump();
            }
            let pushed = std::mem::take(&mut self.pushed);
            let on_ground = self.gaze.on_ground(way * motion.ahead + pushed.x, way * motion.right + pushed.y);
            self.walk.step(seconds, on_ground, solid);
            self.eye = self.walk.eye();
        } else {
            let on_ground = self.gaze.on_ground(way * motion.ahead, way * motion.right);
            self.eye += DVec3::new(on_ground.x, way * motion.up, on_ground.y);
        }
        std::mem::take(&mut self.has_moved) || self.eye != before
    }

    /// A drag begins over this point of the world; none over the background.
    pub const fn begin_drag(&mut self, pivot: Option<DVec3>) {
        self.pivot = pivot;
    }

    /// Looks around, orbits or pans, in a window of this height in pixels.
    pub fn drag(&mut self, Drag { right, down, is_pan }: Drag, height: f64) {
        self.has_moved = true;
        match (self.mode, is_pan, self.pivot) {
            (Mode::Walk, true, _) => {
                // The drag pushes the ground away, like hands on a rail.
                self.pushed += DVec2::new(down, -right) * (self.scale / PUSH);
            }
            (_, true, pivot) => {
                let depth = pivot.map_or(self.scale, |pivot| self.depth_of(pivot));
                let each = 2.0 * depth * (self.vfov_deg.to_radians() / 2.0).tan() / height.max(1.0);
                self.eye = self.gaze.pan(self.eye, -right * each, down * each);
            }
            (Mode::Orbit, false, Some(pivot)) => {
                self.eye = self.gaze.turn_about(pivot, self.eye, -ORBIT * right, -ORBIT * down);
            }
            _ => self.gaze.turn(LOOK * right, LOOK * down),
        }
    }

    /// The wheel was turned away from the person by this many steps: approaches the pivot in orbit mode, else
    /// increases the speed.
    pub fn wheel(&mut self, steps: f64) {
        if self.mode == Mode::Orbit {
            let ahead = self.eye + self.gaze.forward() * (4.0 * self.scale);
            let share = (DOLLY * steps).clamp(-0.5, 0.5);
            self.eye += (self.pivot.unwrap_or(ahead) - self.eye) * share;
            self.has_moved = true;
        } else {
            self.speed = (self.speed * 1.2_f64.powf(steps)).clamp(0.01, 1000.0);
        }
    }

    /// Metres along the viewing direction.
    fn depth_of(&self, point: DVec3) -> f64 {
        (point - self.eye).dot(self.gaze.forward()).max(0.1 * self.scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor everywhere.
    struct Floor;

    impl Solid for Floor {
        fn cell(&self) -> f64 {
            0.1
        }

        fn spans(&self, _: f64, _: f64) -> Option<impl Iterator<Item = [f64; 2]>> {
            Some([[-0.2, 0.0]].into_iter())
        }
    }

    fn start() -> Start {
        let (eye, forward) = (DVec3::new(0.0, 1.7, 0.0), DVec3::NEG_Z);
        Start { eye, forward, eye_height: 1.7, has_floors: true, vfov_deg: 60.0 }
    }

    const STILL: Motion = Motion { ahead: 0.0, right: 0.0, up: 0.0, turn: 0.0, tilt: 0.0 };
    const TENTH: Duration = Duration::from_millis(100);

    fn step(navigator: &mut Navigator, motion: Motion) -> bool {
        navigator.step(TENTH, motion, false, &Floor)
    }

    #[test]
    fn a_walker_stays_on_the_ground_and_rests_when_the_keys_do() {
        let mut navigator = Navigator::new(&start());
        assert!(step(&mut navigator, STILL), "nothing was shown yet");
        assert!(!step(&mut navigator, STILL));
        for _ in 0..10 {
            assert!(step(&mut navigator, Motion { ahead: 1.0, tilt: 1.0, ..STILL }));
        }
        let DVec3 { x, y, z } = navigator.pose().eye;
        assert!((z + 1.4).abs() < 1e-9 && x.abs() < 1e-9 && y == 1.7, "{x} {y} {z}");
        assert!(!step(&mut navigator, STILL));
        // A pause of the machine causes no jump.
        navigator.step(Duration::from_secs(9), Motion { right: 1.0, ..STILL }, true, &Floor);
        assert!((navigator.pose().eye.x - 0.56).abs() < 1e-9, "{}", navigator.pose().eye);
    }

    #[test]
    fn who_flies_goes_through_the_floor_and_who_walks_again_falls_from_there() {
        let mut navigator = Navigator::new(&start());
        navigator.set_mode(Mode::Fly);
        for _ in 0..10 {
            step(&mut navigator, Motion { up: 1.0, ..STILL });
        }
        assert!((navigator.pose().eye.y - 3.1).abs() < 1e-9);
        navigator.set_mode(Mode::Walk);
        for _ in 0..20 {
            step(&mut navigator, STILL);
        }
        assert!((navigator.pose().eye.y - 1.7).abs() < 1e-9);
    }

    #[test]
    fn a_drag_turns_the_gaze_goes_round_a_point_or_across() {
        let drag = Drag { right: 100.0, down: 0.0, is_pan: false };
        let mut navigator = Navigator::new(&start());
        navigator.drag(drag, 600.0);
        assert!((navigator.pose().gaze.heading - 0.3).abs() < 1e-12);
        let pivot = DVec3::new(0.0, 1.7, -5.0);
        let mut navigator = Navigator::new(&start());
        navigator.set_mode(Mode::Orbit);
        navigator.begin_drag(Some(pivot));
        navigator.drag(drag, 600.0);
        assert!((navigator.pose().eye.distance(pivot) - 5.0).abs() < 1e-9);
        assert!(
            ((pivot - navigator.pose().eye).normalize() - navigator.pose().gaze.forward()).length() < 1e-9
        );
        // A point 5 m away follows the pointer.
        let mut navigator = Navigator::new(&start());
        navigator.set_mode(Mode::Fly);
        navigator.begin_drag(Some(pivot));
        navigator.drag(Drag { right: 600.0, is_pan: true, ..drag }, 600.0);
        let height = 2.0 * 5.0 * 30.0_f64.to_radians().tan();
        assert!((navigator.pose().eye.x + height).abs() < 1e-9, "{}", navigator.pose().eye);
        // A walker is pushed along the ground.
        let mut navigator = Navigator::new(&start());
        navigator.drag(Drag { right: 0.0, down: PUSH, is_pan: true }, 600.0);
        step(&mut navigator, STILL);
        assert!((navigator.pose().eye - DVec3::new(0.0, 1.7, -1.7)).length() < 1e-9);
    }

    #[test]
    fn the_wheel_makes_faster_and_who_orbits_goes_nearer() {
        let mut navigator = Navigator::new(&start());
        navigator.wheel(2.0);
        assert!((navigator.speed() - 1.4 * 1.44).abs() < 1e-12);
        navigator.wheel(-1e9);
        assert_eq!(navigator.speed(), 0.01);
        navigator.set_mode(Mode::Orbit);
        navigator.begin_drag(Some(DVec3::new(0.0, 1.7, -10.0)));
        navigator.wheel(1.0);
        assert!((navigator.pose().eye.z + 1.5).abs() < 1e-12);
        for _ in 0..99 {
            navigator.wheel(9.0);
        }
        assert!(navigator.pose().eye.z > -10.0 - 1e-9, "nobody goes beyond it");
    }

    #[test]
    fn a_field_of_view_stays_within_reason() {
        let mut navigator = Navigator::new(&start());
        step(&mut navigator, STILL);
        navigator.set_vfov(500.0);
        assert_eq!(navigator.vfov_deg(), WIDEST);
        assert!(step(&mut navigator, STILL), "it shows at once");
    }
}
