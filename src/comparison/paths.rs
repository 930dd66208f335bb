//! The same places in another order, or at another pace, to measure the value of coherence between frames.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_scene::path::{PathError, Pose, PosePath};

/// How much consecutive frames have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Coherence {
    /// A quarter of the walk's pace: three frames between each two of its poses.
    Slow,
    /// The walk as it is.
    Walk,
    /// A turn on the spot, 6 degrees a frame, at places of the walk.
    Turn,
    /// The walk's poses in an order in which no two consecutive ones are near.
    Teleport,
}

/// Why a walk has no such form.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PathsError {
    /// The poses make no valid path.
    #[error("the walk's poses make no path of another pace")]
    Path(#[from] PathError),
    /// A pose between two of the walk is invalid.
    #[error("a pose between two of the walk is none")]
    Pose(#[from] trimaran_scene::path::PoseError),
}

/// Degrees a frame of a turn on the spot.
const TURN_DEG: f64 = 6.0;
/// Frames of a whole turn.
const TURN_FRAMES: usize = 60;

impl Coherence {
    /// From most to least coherent.
    pub const ALL: [Self; 4] = [Self::Slow, Self::Walk, Self::Turn, Self::Teleport];

    /// The name in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Slow => "slow",
            Self::Walk => "walk",
            Self::Turn => "turn",
            Self::Teleport => "teleport",
        }
    }

    /// As many frames as `walk` has, with this much in common. Its field of view and near plane stay.
    ///
    /// # Errors
    /// If a pose between two of the walk is invalid: they look in opposite directions.
    pub fn path(self, walk: &PosePath) -> Result<PosePath, PathsError> {
        let poses = walk.frames();
        let count = poses.len();
        let poses: Vec<Pose> = match self {
            Self::Walk => poses.to_vec(),
            Self::Slow => (0..count).map(|frame| between(poses, frame)).collect::<Result<_, _>>()?,
            Self::Turn => (0..count).map(|frame| turned(poses, frame)).collect::<Result<_, _>>()?,
            Self::Teleport => {
                let stride = stride(count);
                (0..count).filter_map(|frame| poses.get(frame * stride % count)).copied().collect()
            }
        };
        let path = PosePath::new(walk.vfov_deg(), poses)?;
        match walk.near() {
            Some(near) => Ok(path.with_near(near.into())?),
            None => Ok(path),
        }
    }
}

/// A quarter of the way into the walk for each quarter of a frame.
fn between(poses: &[Pose], frame: usize) -> Result<Pose, PathsError> {
    let (from, part) = (frame / 4, (frame % 4) as f64 / 4.0);
    let pose = |at: usize| poses.get(at).or(poses.last()).ok_or(PathError::NoFrames);
    let (a, b) = (pose(from)?, pose(from + 1)?);
    if part == 0.0 {
        return Ok(*a);
    }
    let orientation = a.orientation().slerp(b.orientation(), part);
    Ok(Pose::new(a.eye().lerp(b.eye(), part), orientation * DVec3::NEG_Z, orientation * DVec3::Y)?)
}

/// Turns about the upward direction of a pose: a whole turn at each of several places spread over the walk.
fn turned(poses: &[Pose], frame: usize) -> Result<Pose, PathsError> {
    let turns = poses.len().div_ceil(TURN_FRAMES).max(1);
    let place = (frame / TURN_FRAMES) * poses.len() / turns;
    let pose = poses.get(place).ok_or(PathError::NoFrames)?;
    let angle = (TURN_DEG * (frame % TURN_FRAMES) as f64).to_radians();
    let turn = DQuat::from_axis_angle(pose.orientation() * DVec3::Y, angle);
    Ok(Pose::new(pose.eye(), turn * pose.forward(), pose.up())?)
}

/// A stride that visits each of `count` poses once, and far from the one before: near their golden section,
/// and coprime to `count`.
fn stride(count: usize) -> usize {
    let golden = (count as f64 * 0.618).round() as usize;
    (golden.max(1)..).find(|step| divisor(*step, count) == 1).unwrap_or(1)
}

const fn divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps of a metre along x, looking aside and turning a little.
    fn walk(frames: u32) -> PosePath {
        let pose = |n: u32| {
            let angle = 0.01 * f64::from(n);
            Pose::new(DVec3::X * f64::from(n), DVec3::new(angle.sin(), angle.cos(), 0.0), DVec3::Z).unwrap()
        };
        PosePath::new(60.0, (0..frames).map(pose).collect()).unwrap().with_near(0.2).unwrap()
    }

    fn eyes(path: &PosePath) -> Vec<f64> {
        path.frames().iter().map(|pose| pose.eye().x).collect()
    }

    #[test]
    fn a_slow_walk_takes_four_frames_for_a_step() {
        let slow = Coherence::Slow.path(&walk(9)).unwrap();
        assert_eq!(eyes(&slow), [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0]);
        assert_eq!((slow.vfov_deg(), slow.near()), (60.0, Some(0.2)));
        let (walked, slow) = (walk(9), slow.frames().to_vec());
        let angle = |a: &Pose, b: &Pose| a.orientation().angle_between(b.orientation());
        assert!((angle(&slow[1], &slow[2]) - 0.0025).abs() < 1e-9);
        assert!(angle(&slow[4], &walked.frames()[1]) < 1e-9);
    }

    #[test]
    fn a_turn_stays_where_it_is_and_comes_around() {
        let path = Coherence::Turn.path(&walk(120)).unwrap();
        let eyes = eyes(&path);
        assert!(eyes[..60].iter().all(|x| *x == 0.0) && eyes[60..].iter().all(|x| *x == 60.0), "{eyes:?}");
        let frames = path.frames();
        let step = |at: usize| frames[at].forward().angle_between(frames[at + 1].forward()).to_degrees();
        assert!((0..59).all(|at| (step(at) - TURN_DEG).abs() < 1e-6));
        let last = frames[59].forward().angle_between(frames[0].forward()).to_degrees();
        assert!((last - TURN_DEG).abs() < 1e-6, "{last}");
    }

    #[test]
    fn a_teleport_comes_to_each_place_once_and_never_to_a_neighbour() {
        for count in [2, 3, 7, 60, 120, 200] {
            let mut eyes = eyes(&Coherence::Teleport.path(&walk(count)).unwrap());
            if count > 7 {
                let steps = eyes.windows(2).map(|pair| (pair[1] - pair[0]).abs());
                assert!(steps.fold(f64::INFINITY, f64::min) > f64::from(count) / 4.0, "{eyes:?}");
            }
            eyes.sort_by(f64::total_cmp);
            assert_eq!(eyes, self::eyes(&walk(count)));
        }
    }

    #[test]
    fn a_walk_of_one_pose_stays_one() {
        for coherence in Coherence::ALL {
            assert_eq!(eyes(&coherence.path(&walk(1)).unwrap()), [0.0], "{coherence:?}");
        }
    }
}
