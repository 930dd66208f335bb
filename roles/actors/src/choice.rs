//! Whether a display that culls for itself culls the next frame by occlusion, or draws all that is in the
//! frustum.
//!
//! Both show the same picture, so only the time decides. The better mode changes with the scene, the view and
//! the device, and is found by trying. [`CullingChoice`] is told what each frame cost, and knows no clock: a
//! cost is a time, or an estimate by counts.
//!
//! - The other mode is tried for up to three frames. The first one does not count, because geometry may come
//!   for it. If the other two cost less than the median of the last frames, the mode changes.
//! - Trials that lose become rarer. What they cost more than other frames is at most a 32nd of all time,
//!   beyond the first trial.
//! - If the cost changes by half, another trial follows at once, and soon if the view state changes.
//! - A frame for which the frustum would suddenly cost three times as much, by counts, is culled.

use std::collections::VecDeque;

use crate::median::median;

/// How a display finds the drawables of a frame that it culls itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Those that are not hidden.
    Occlusion,
    /// All of the LOD cut in the frustum.
    Frustum,
}

impl Mode {
    const fn other(self) -> Self {
        match self {
            Self::Occlusion => Self::Frustum,
            Self::Frustum => Self::Occlusion,
        }
    }
}

/// How many of the last costs make a median.
const KEPT: usize = 5;
/// How many frames pass before a trial: at first, and at most.
const SOON: u32 = 8;
const SELDOM: u32 = 128;
/// How many frames of a trial have to cost less, after the first one.
const WINS: usize = 2;
/// A mode is cheaper if it costs less by more than this part of the median. Trials may cost this part of all
/// time. They may save up the cost of `SAVED` frames, or owe as much.
const PART: u64 = 32;
const SAVED: u64 = 8;
/// A trial of the frustum is not drawn if it would cost this many times the last culled frame, by counts.
/// Where counts decide, it is not if it would cost more at all. Outside of a trial a frame is not drawn so if
/// it would cost this many times the last one: after a jump, say.
const TOO_DEAR: u64 = 3;

/// The choice of a display, frame by frame. Costs are in nanoseconds.
#[derive(Debug, Clone)]
pub(crate) struct CullingChoice {
    mode: Mode,
    /// The last costs in this mode, outside of trials.
    costs: VecDeque<u64>,
    /// Their median when the other mode was last tried.
    tried_at: u64,
    /// The costs of a trial's frames so far, while one lasts.
    trial: Option<Vec<u64>>,
    /// After how many frames the next one begins, and the one after it if it loses.
    wait: u32,
    interval: u32,
    /// The cost that trials may still have; below 0 none begins.
    saved: i64,
    /// The costs of the last frame of each mode, by counts.
    counted: [Option<u64>; 2],
}

impl Default for CullingChoice {
    /// The first frames are culled.
    fn default() -> Self {
        Self {
            mode: Mode::Occlusion,
            costs: VecDeque::with_capacity(KEPT),
            tried_at: 0,
            trial: None,
            wait: SOON,
            interval: SOON,
            saved: 0,
            counted: [None; 2],
        }
    }
}

impl CullingChoice {
    /// The mode of the next frame.
    pub(crate) const fn mode(&self) -> Mode {
        if self.trial.is_some() { self.mode.other() } else { self.mode }
    }

    /// Whether a frame that was found by the frustum may be drawn so, if it costs `counted` by counts. If
    /// not, it is culled instead: a trial must not stop the picture for long.
    pub(crate) fn may_draw_frustum(&self, counted: u64, counts_decide: bool) -> bool {
        let most = if counts_decide && self.mode == Mode::Occlusion { 1 } else { TOO_DEAR };
        let [culled, all] = self.counted;
        let usual = if self.mode == Mode::Frustum { all } else { culled };
        usual.is_some_and(|usual| counted <= usual.saturating_mul(most))
    }

    /// A frame was drawn in this `mode` at this `cost`, which is `counted` by counts.
    pub(crate) fn drawn(&mut self, mode: Mode, cost: u64, counted: u64) {
        if let Some(last) = self.counted.get_mut(mode as usize) {
            *last = Some(counted);
        }
        match self.trial.take() {
            Some(trial) if mode != self.mode => self.tried(trial, cost),
            Some(_) => {
                self.lost();
                self.settled(cost);
            }
            // The frame was too dear to be drawn as usual, and so will be the next ones.
            None if mode != self.mode => self.change([cost].into()),
            None => self.settled(cost),
        }
    }

    /// The view state has changed: what was known of the other mode may no longer hold.
    pub(crate) fn look_again(&mut self) {
        self.interval = SOON;
        self.wait = self.wait.min(SOON);
    }

    /// A frame of a trial was drawn.
    fn tried(&mut self, mut trial: Vec<u64>, cost: u64) {
        let usual = self.median();
        self.saved = self.saved.saturating_sub_unsigned(cost.saturating_sub(usual));
        trial.push(cost);
        if trial.len() == 1 {
            self.trial = Some(trial);
        } else if cost >= usual - usual / PART {
            self.lost();
        } else if trial.len() <= WINS {
            self.trial = Some(trial);
        } else {
            self.change(trial.into_iter().skip(1).collect());
        }
    }

    /// The other mode from now on, whose last frames had these costs.
    fn change(&mut self, costs: VecDeque<u64>) {
        self.mode = self.mode.other();
        self.costs = costs;
        self.tried_at = self.median();
        (self.interval, self.wait) = (SOON, SOON);
    }

    fn lost(&mut self) {
        self.tried_at = self.median();
        self.interval = (2 * self.interval).min(SELDOM);
        self.wait = self.interval;
    }

    /// A frame outside of trials was drawn.
    fn settled(&mut self, cost: u64) {
        if self.costs.len() == KEPT {
            self.costs.pop_front();
        }
        self.costs.push_back(cost);
        self.wait = self.wait.saturating_sub(1);
        let usual = self.median();
        let most = i64::try_from(usual.saturating_mul(SAVED)).unwrap_or(i64::MAX);
        self.saved = self.saved.saturating_add_unsigned(cost / PART).min(most);
        let changed = self.has_changed();
        if changed {
            // Only these say what the mode costs now.
            self.costs.drain(..self.costs.len().saturating_sub(2));
            self.tried_at = self.median();
            (self.interval, self.wait) = (SOON, 0);
        }
        // After a change one trial may be on credit.
        if self.wait == 0 && self.saved >= if changed { -most } else { 0 } {
            self.trial = Some(Vec::with_capacity(1 + WINS));
        }
    }

    /// Whether the last two frames cost more than half as much again as when the other mode was tried, or
    /// less by as much. A single one may have been interrupted.
    fn has_changed(&self) -> bool {
        let (low, high) =
            (self.tried_at - self.tried_at / 3, self.tried_at.saturating_add(self.tried_at / 2));
        let mut last = self.costs.iter().rev().take(2);
        let both = self.tried_at > 0 && self.costs.len() > 1;
        both && (last.clone().all(|cost| *cost > high) || last.all(|cost| *cost < low))
    }

    fn median(&self) -> u64 {
        median(self.costs.iter().copied()).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The cost of all `frames` in the modes chosen, and these modes, if each frame costs that much.
    fn play(choice: &mut CullingChoice, frames: &[[u64; 2]]) -> (u64, Vec<Mode>) {
        let mut modes = Vec::new();
        let mut total = 0;
        for costs in frames {
            let mode = choice.mode();
            let cost = costs[mode as usize];
            choice.drawn(mode, cost, cost);
            modes.push(mode);
            total += cost;
        }
        (total, modes)
    }

    /// Frames that cost about that much: each cost differs from it by up to this many hundredths.
    fn frames(costs: [u64; 2], noise: u64, count: usize) -> impl Strategy<Value = Vec<[u64; 2]>> {
        let about = move |cost: u64| (100 - noise..=100 + noise).prop_map(move |part| cost * part / 100);
        proptest::collection::vec((about(costs[0]), about(costs[1])).prop_map(<[u64; 2]>::from), count)
    }

    fn total(frames: &[[u64; 2]], mode: Mode) -> u64 {
        frames.iter().map(|costs| costs[mode as usize]).sum()
    }

    fn costs() -> impl Strategy<Value = [u64; 2]> {
        [1_000_000_u64..20_000_000, 1_000_000_u64..20_000_000]
    }

    proptest! {
        #[test]
        fn all_frames_cost_at_most_a_tenth_more_than_in_the_better_mode_beside_the_start(
            frames in costs().prop_flat_map(|costs| frames(costs, 20, 1500)),
        ) {
            let (spent, modes) = play(&mut CullingChoice::default(), &frames);
            prop_assert!(modes[..SOON as usize].iter().all(|mode| *mode == Mode::Occlusion));
            let best = total(&frames, Mode::Occlusion).min(total(&frames, Mode::Frustum));
            let start = 20 * frames[..20].iter().flatten().max().unwrap();
            prop_assert!(spent <= best + best / 10 + start, "{spent} {best} {start}");
        }

        #[test]
        fn it_follows_a_change(low in 1_000_000_u64..2_000_000, ratio in 2_u64..10, first in 0..2) {
            let high = low * ratio;
            let mut costs = [low, high];
            costs.rotate_left(first as usize);
            let mut choice = CullingChoice::default();
            let (_, modes) = play(&mut choice, &[costs; 400]);
            let better = |costs: [u64; 2]| {
                if costs[0] < costs[1] { Mode::Occlusion } else { Mode::Frustum }
            };
            prop_assert_eq!(choice.mode, better(costs), "{:?}", modes);
            costs.reverse();
            play(&mut choice, &[costs; 64]);
            prop_assert_eq!(choice.mode, better(costs));
        }

        #[test]
        fn equal_costs_give_equal_choices(frames in costs().prop_flat_map(|costs| frames(costs, 60, 300))) {
            let modes = || play(&mut CullingChoice::default(), &frames).1;
            prop_assert_eq!(modes(), modes());
        }
    }

    #[test]
    fn trials_that_lose_become_rare() {
        let (_, modes) = play(&mut CullingChoice::default(), &[[2_000_000, 3_000_000]; 2000]);
        let tried: Vec<_> = (1..modes.len()).filter(|at| modes[*at] != modes[at - 1]).collect();
        let begun: Vec<_> = tried.iter().step_by(2).copied().collect();
        assert_eq!(begun[..6], [8, 34, 68, 134, 264, 394]);
        assert!(tried.chunks_exact(2).all(|trial| trial[1] - trial[0] == 2), "{tried:?}");
    }

    #[test]
    fn a_frame_that_would_cost_too_much_is_not_drawn_and_counts_as_a_lost_trial() {
        let mut choice = CullingChoice::default();
        assert!(!choice.may_draw_frustum(0, false), "nothing is known to compare it with");
        for _ in 0..SOON {
            choice.drawn(Mode::Occlusion, 70, 100);
        }
        assert_eq!(choice.mode(), Mode::Frustum);
        assert!(choice.may_draw_frustum(300, false) && !choice.may_draw_frustum(301, false));
        assert!(choice.may_draw_frustum(100, true) && !choice.may_draw_frustum(101, true));
        choice.drawn(Mode::Occlusion, 70, 100);
        assert_eq!((choice.mode(), choice.wait), (Mode::Occlusion, 2 * SOON - 1));
    }

    /// The camera jumps to where a hundred times as much is in the frustum.
    #[test]
    fn a_frame_that_is_suddenly_too_dear_is_culled_and_the_frustum_is_tried_again_soon() {
        let mut choice = CullingChoice::default();
        play(&mut choice, &[[200, 100]; 2 * SOON as usize]);
        assert_eq!(choice.mode(), Mode::Frustum);
        for counts_decide in [false, true] {
            assert!(choice.may_draw_frustum(300, counts_decide));
            assert!(!choice.may_draw_frustum(301, counts_decide));
        }
        choice.drawn(Mode::Occlusion, 250, 250);
        assert_eq!(choice.mode(), Mode::Occlusion);
        let (_, modes) = play(&mut choice, &[[250, 240]; 2 * SOON as usize]);
        assert!(modes[..SOON as usize].iter().all(|mode| *mode == Mode::Occlusion), "{modes:?}");
        assert_eq!(modes.last(), Some(&Mode::Frustum));
    }

    #[test]
    fn a_jump_is_answered_after_two_frames_and_an_interruption_is_not() {
        for (costs, tried) in [([400, 100], false), ([400, 400], true), ([140, 140], false), ([60, 60], true)]
        {
            let mut choice = CullingChoice::default();
            play(&mut choice, &[[100, 110]; 300]);
            while choice.wait < SELDOM / 2 {
                play(&mut choice, &[[100, 110]]);
            }
            play(&mut choice, &costs.map(|cost| [cost, 110]));
            assert_eq!(choice.mode() == Mode::Frustum, tried, "{costs:?}");
        }
    }

    #[test]
    fn another_view_is_tried_soon() {
        let mut choice = CullingChoice::default();
        play(&mut choice, &[[100, 200]; 300]);
        assert!(choice.wait > SOON, "{choice:?}");
        choice.look_again();
        let (_, modes) = play(&mut choice, &[[100, 50]; 2 * SOON as usize]);
        assert_eq!(modes.last(), Some(&Mode::Frustum));
    }
}
