//! Predicts the eye's pose from its recent motion.

use std::{collections::VecDeque, f64::consts::TAU, time::Duration};

use glam::DVec3;

use super::gaze::Gaze;

/// The past from which the future is predicted.
const PAST: Duration = Duration::from_millis(100);
/// The limit of prediction: by then the hand has done something else.
const FURTHEST: Duration = Duration::from_millis(250);

/// A place and a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Metres in the world.
    pub eye: DVec3,
    /// The viewing direction.
    pub gaze: Gaze,
}

/// Follows an eye.
#[derive(Debug, Default)]
pub struct Prediction {
    past: VecDeque<(Duration, Pose)>,
}

impl Prediction {
    /// The eye is here at this time, which is not before the last one.
    pub fn add(&mut self, at: Duration, pose: Pose) {
        self.past.push_back((at, pose));
        while self.past.len() > 2 && self.past.get(1).is_some_and(|(then, _)| *then + PAST <= at) {
            self.past.pop_front();
        }
    }

    /// The eye has jumped, so the past is discarded.
    pub fn forget(&mut self) {
        self.past.clear();
    }

    /// The pose this long after the last one; none if there is no past.
    #[must_use]
    pub fn after(&self, ahead: Duration) -> Option<Pose> {
        let ((before, from), (now, here)) = (self.past.front()?, self.past.back()?);
        let past = now.saturating_sub(*before).as_secs_f64();
        let share = if past > 0.0 { ahead.min(FURTHEST).as_secs_f64() / past } else { 0.0 };
        let turned = here.gaze.heading - from.gaze.heading;
        // The shorter way round.
        let turned = turned - TAU * (turned / TAU).round();
        let gaze = Gaze {
            heading: here.gaze.heading + turned * share,
            pitch: here.gaze.pitch + (here.gaze.pitch - from.gaze.pitch) * share,
        };
        Some(Pose { eye: here.eye + (here.eye - from.eye) * share, gaze })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn pose(x: f64, heading: f64) -> Pose {
        Pose { eye: DVec3::new(x, 0.0, 0.0), gaze: Gaze { heading, pitch: 0.0 } }
    }

    #[test]
    fn an_eye_goes_on_as_it_did_in_the_last_tenth_of_a_second() {
        let mut prediction = Prediction::default();
        assert_eq!(prediction.after(ms(50)), None);
        prediction.add(ms(0), pose(0.0, 0.0));
        assert_eq!(prediction.after(ms(50)), Some(pose(0.0, 0.0)), "nothing is known of its way");
        for step in 1..=20 {
            // It rests for half a second, and then moves at 1 m/s.
            prediction.add(ms(50 * step), pose((step as f64 - 10.0).max(0.0) * 0.05, 0.0));
        }
        let ahead = prediction.after(ms(100)).unwrap().eye.x;
        assert!((ahead - 0.6).abs() < 1e-9, "{ahead}");
        let furthest = prediction.after(ms(9000)).unwrap().eye.x;
        assert!((furthest - 0.75).abs() < 1e-9, "{furthest}");
        prediction.forget();
        assert_eq!(prediction.after(ms(50)), None);
    }

    #[test]
    fn an_eye_turns_the_short_way_round() {
        let mut prediction = Prediction::default();
        prediction.add(ms(0), pose(0.0, 3.1));
        prediction.add(ms(100), pose(0.0, -3.1));
        let heading = prediction.after(ms(100)).unwrap().gaze.heading;
        assert!((heading - (-3.1 + TAU - 6.2)).abs() < 1e-9, "{heading}");
    }
}
