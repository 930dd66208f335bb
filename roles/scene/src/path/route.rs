//! Makes frames from places: walks a line at a steady speed, turning smoothly.

use glam::DVec3;

use super::{
    flood::{Body, Flood},
    gaze::wrapped,
    pose::Pose,
    space::Space,
};
use crate::random::Random;

/// The walker's speeds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    /// Metres a frame.
    pub(super) step: f64,
    /// The most it turns in a frame, radians.
    pub(super) turn: f64,
}

/// A line of eyes through a flood, at least `length` metres long if the ground allows: to the farthest cell,
/// then on to random ones. Needless corners are cut.
pub(super) fn line(
    space: &Space<'_>,
    body: &Body,
    flood: &Flood,
    length: f64,
    random: &mut Random,
) -> Vec<DVec3> {
    const MOST_LEGS: usize = 200;
    let (mut line, mut at) = (vec![flood.eye(0)], 0);
    let mut walked = 0.0;
    for leg in 0..MOST_LEGS {
        let to = if leg == 0 { flood.farthest() } else { random.below(flood.len()) };
        let way = shortcut(space, body, &flood.path(at, to));
        walked += way.windows(2).map(|pair| pair[0].distance(pair[1])).sum::<f64>();
        line.extend(way.into_iter().skip(1));
        at = to;
        if walked >= length {
            break;
        }
    }
    line
}

/// The same path with fewer corners: from each point straight to the farthest of the next ones within reach.
fn shortcut(space: &Space<'_>, body: &Body, way: &[DVec3]) -> Vec<DVec3> {
    const AHEAD: usize = 24;
    let mut line: Vec<DVec3> = way.first().copied().into_iter().collect();
    let mut at = 0;
    while at + 1 < way.len() {
        let straight =
            |&to: &usize| body.passes(space, way[at], way[to]) && body.carried(space, way[at], way[to]);
        let last = (at + AHEAD).min(way.len() - 1);
        // Halving the reach costs few queries and finds a straight stretch nearly always.
        let mut to = last;
        while to > at + 1 && !straight(&to) {
            to = at + (to - at) / 2;
        }
        line.push(way[to]);
        at = to;
    }
    line
}

/// Walks a line in `frames` frames. `look` chooses the gaze from the eye, the angle of the path ahead and the
/// present gaze; it swings a little from side to side. The walker waits while the path lies behind it. At the
/// end of the line it stands and looks around.
pub(super) fn walk(
    line: &[DVec3],
    frames: usize,
    pace: Pace,
    random: &mut Random,
    look: impl Fn(DVec3, f64, f64) -> f64,
) -> Vec<Pose> {
    /// The number of frames between choices of a gaze.
    const GLANCE: usize = 10;
    let lengths: Vec<f64> = line
        .windows(2)
        .scan(0.0, |sum, pair| {
            *sum += pair[0].distance(pair[1]);
            Some(*sum)
        })
        .collect();
    let total = lengths.last().copied().unwrap_or(0.0);
    let at = |distance: f64| -> DVec3 {
        let leg = lengths.partition_point(|&end| end < distance);
        match line.get(leg..leg + 2) {
            Some(&[from, to]) => {
                let back = (lengths[leg] - distance) / from.distance(to).max(f64::MIN_POSITIVE);
                to.lerp(from, back.clamp(0.0, 1.0))
            }
            _ => line.last().copied().unwrap_or_default(),
        }
    };
    let heading = |distance: f64| {
        let ahead = at(distance + 20.0 * pace.step) - at(distance);
        (ahead.x.abs() + ahead.z.abs() > pace.step * 0.1).then(|| libm::atan2(ahead.x, ahead.z))
    };
    let phase = random.between(0.0, std::f64::consts::TAU);
    let (mut distance, mut aim) = (0.0, heading(0.0).unwrap_or(phase));
    let mut view = look(at(0.0), aim, aim);
    let mut gaze = view;
    (0..frames)
        .filter_map(|frame| {
            let swing = 0.2 * libm::sin(phase + frame as f64 * 0.045);
            aim = if distance < total { heading(distance).unwrap_or(aim) } else { aim + pace.turn * 0.7 };
            let eye = at(distance);
            if frame % GLANCE == 0 {
                view = look(eye, aim, gaze);
            }
            let turn = wrapped(view + swing - gaze);
            gaze += turn.clamp(-pace.turn, pace.turn);
            // Full speed while the path lies ahead or aside, none while it lies behind.
            let off = wrapped(aim - gaze).abs();
            distance += pace.step * (2.4 - off).clamp(0.0, 1.0);
            let (sine, cosine) = libm::sincos(gaze);
            Pose::new(eye, DVec3::new(sine, -0.08, cosine).normalize(), DVec3::Y).ok()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACE: Pace = Pace { step: 0.05, turn: 0.07 };

    #[test]
    fn a_line_is_walked_at_its_pace_with_bounded_turns() {
        let line = [DVec3::ZERO, DVec3::X * 2.0, DVec3::new(2.0, 0.0, 2.0)];
        let frames = walk(&line, 120, PACE, &mut Random::new(3), |_, ahead, _| ahead);
        assert_eq!(frames.len(), 120);
        for pair in frames.windows(2) {
            assert!(pair[0].eye().distance(pair[1].eye()) <= PACE.step + 1e-12);
            assert!(pair[0].forward().angle_between(pair[1].forward()) <= PACE.turn + 1e-9);
        }
        assert!(frames[119].eye().distance(line[2]) < 1e-9, "it arrives: {}", frames[119].eye());
    }

    #[test]
    fn a_single_point_is_a_place_to_look_around() {
        let frames = walk(&[DVec3::ONE], 50, PACE, &mut Random::new(3), |_, ahead, _| ahead);
        assert!(frames.iter().all(|f| f.eye() == DVec3::ONE));
        assert!(frames[0].forward().angle_between(frames[49].forward()) > 0.3);
    }
}
