//! A walk with poses interpolated between written ones.

use std::time::Duration;

use glam::DVec3;
use trimaran_scene::path::PosePath;

/// Poses a second of a written path.
const RATE: f64 = 30.0;
/// A step this many times as long as the median one is a jump.
const JUMP: f64 = 10.0;

/// A pose of a walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    pub(super) eye: DVec3,
    /// Of any length.
    pub(super) forward: DVec3,
    /// The eye has jumped here.
    pub(super) is_jump: bool,
}

/// The poses by time.
#[derive(Debug)]
pub(super) struct Way {
    vfov_deg: f64,
    poses: Vec<(DVec3, DVec3)>,
    /// Steps at least this long are jumps.
    jump: f64,
}

impl Way {
    pub(super) fn new(path: &PosePath) -> Self {
        let poses: Vec<_> = path.frames().iter().map(|pose| (pose.eye(), pose.forward())).collect();
        let mut way = Self { vfov_deg: path.vfov_deg(), poses, jump: 0.0 };
        let mut steps: Vec<_> = (0..way.poses.len()).map(|at| way.length(at)).collect();
        steps.sort_by(f64::total_cmp);
        way.jump = JUMP * steps.get(steps.len() / 2).copied().unwrap_or_default();
        way
    }

    pub(super) const fn vfov_deg(&self) -> f64 {
        self.vfov_deg
    }

    /// The pose after this time, if the last one was requested at `before`; nothing behind the end.
    pub(super) fn at(&self, time: Duration, before: Duration) -> Option<Step> {
        let place = time.as_secs_f64() * RATE;
        let at = place as usize;
        let (eye, forward) = *self.poses.get(at)?;
        let passed = (before.as_secs_f64() * RATE) as usize + 1;
        let is_jump = (passed..=at).any(|passed| self.is_jump(passed));
        let next = self.poses.get(at + 1).filter(|_| !self.is_jump(at + 1));
        let share = place.fract();
        let between = |from: DVec3, to: Option<DVec3>| to.map_or(from, |to| from.lerp(to, share));
        let eye = between(eye, next.map(|next| next.0));
        Some(Step { eye, forward: between(forward, next.map(|next| next.1)), is_jump })
    }

    fn is_jump(&self, at: usize) -> bool {
        self.length(at) > self.jump
    }

    /// The distance from the previous pose.
    fn length(&self, at: usize) -> f64 {
        let before = at.checked_sub(1).and_then(|before| self.poses.get(before));
        before.zip(self.poses.get(at)).map_or(0.0, |(from, to)| from.0.distance(to.0))
    }
}

#[cfg(test)]
mod tests {
    use trimaran_scene::path::Pose;

    use super::*;

    #[test]
    fn a_walk_goes_between_its_poses_and_leaps_where_it_jumps() {
        let pose = |x: f64| Pose::new(DVec3::new(x, 0.0, 0.0), DVec3::NEG_Z, DVec3::Y).unwrap();
        let poses = [0.0, 1.0, 2.0, 100.0, 101.0].map(pose).to_vec();
        let way = Way::new(&PosePath::new(60.0, poses).unwrap());
        let at = |frames: f64, before: f64| {
            let seconds = |frames: f64| Duration::from_secs_f64(frames / RATE);
            way.at(seconds(frames), seconds(before)).map(|step| (step.eye.x, step.is_jump))
        };
        assert_eq!(at(0.0, 0.0), Some((0.0, false)));
        assert!((at(1.5, 0.0).unwrap().0 - 1.5).abs() < 1e-9);
        assert_eq!(at(2.5, 1.5), Some((2.0, false)), "nobody goes half of a jump");
        assert!(at(3.25, 2.5).unwrap().1);
        assert!(!at(3.5, 3.25).unwrap().1, "once");
        assert_eq!(at(4.99, 3.5).map(|step| step.0), Some(101.0));
        assert_eq!(at(5.01, 4.99), None);
    }
}
