//! The smallest trial that still fails.

use glam::DVec3;
use trimaran_proto::ObjectSet;

use super::trial::{Shape, Solid, Trial, TrialFrame, upright};

/// Digits that numbers are rounded to, the fewest first.
const DIGITS: [usize; 4] = [1, 2, 3, 5];

/// Removes objects and frames of a failing trial, and simplifies the rest, as long as it fails. Tries at most
/// `tries` trials.
pub fn shrink(trial: Trial, tries: u32, fails: impl FnMut(&Trial) -> bool) -> Trial {
    let mut shrinker = Shrinker { best: trial, tries, fails };
    while shrinker.tries > 0 {
        let before = shrinker.best.clone();
        shrinker.remove(|trial| trial.frames.len(), |trial, from, to| drop(trial.frames.drain(from..to)));
        shrinker.remove(|trial| trial.solids.len(), Trial::remove_solids);
        shrinker.simplify_frames();
        shrinker.simplify_solids();
        shrinker.simplify_numbers();
        if shrinker.best == before {
            break;
        }
    }
    shrinker.best
}

struct Shrinker<F> {
    best: Trial,
    tries: u32,
    fails: F,
}

impl<F: FnMut(&Trial) -> bool> Shrinker<F> {
    /// Keeps an edit after which the trial still fails.
    fn attempt(&mut self, edit: impl FnOnce(&mut Trial)) -> bool {
        let mut edited = self.best.clone();
        edit(&mut edited);
        if self.tries == 0 || edited == self.best {
            return false;
        }
        self.tries -= 1;
        let fails = (self.fails)(&edited);
        if fails {
            self.best = edited;
        }
        fails
    }

    /// Removes runs of a list, the longest first.
    fn remove(&mut self, count: impl Fn(&Trial) -> usize, remove: impl Fn(&mut Trial, usize, usize)) {
        let mut run = count(&self.best) / 2;
        while run > 0 {
            let mut from = 0;
            while from < count(&self.best) && count(&self.best) > 1 {
                let to = (from + run).min(count(&self.best));
                if !self.attempt(|trial| remove(trial, from, to)) {
                    from = to;
                }
            }
            run /= 2;
        }
    }

    fn simplify_frames(&mut self) {
        for number in 0..self.best.frames.len() {
            let edits: [fn(&mut TrialFrame); 5] = [
                |frame| frame.sections.clear(),
                |frame| frame.hidden = ObjectSet::default(),
                |frame| frame.isolated = None,
                |frame| frame.see_through = ObjectSet::default(),
                |frame| frame.roll = 0.0,
            ];
            for edit in edits {
                self.attempt(|trial| trial.frames.get_mut(number).into_iter().for_each(edit));
            }
        }
        let Some(first) = self.best.frames.first().cloned() else { return };
        self.attempt(|trial| trial.frames.iter_mut().for_each(|frame| frame.size = first.size));
        self.attempt(|trial| trial.frames.iter_mut().for_each(|frame| frame.near = first.near));
        self.attempt(|trial| trial.frames.iter_mut().for_each(|frame| frame.fov = first.fov));
        self.attempt(|trial| trial.frames.iter_mut().for_each(|frame| frame.epsilon = first.epsilon));
    }

    fn simplify_solids(&mut self) {
        self.attempt(|trial| trial.merged = false);
        for number in 0..self.best.solids.len() {
            let edits: [fn(&mut Solid); 5] = [
                |solid| solid.coarser.clear(),
                |solid| drop(solid.coarser.pop()),
                |solid| solid.most = None,
                |solid| solid.linear = upright(),
                |solid| solid.shape.uncut(),
            ];
            for edit in edits {
                self.attempt(|trial| trial.solids.get_mut(number).into_iter().for_each(edit));
            }
            let count = |trial: &Trial| match trial.solids.get(number).map(|solid| &solid.shape) {
                Some(Shape::Triangles(triangles)) => triangles.len(),
                _ => 0,
            };
            self.remove(count, |trial, from, to| {
                if let Some(Solid { shape: Shape::Triangles(triangles), .. }) = trial.solids.get_mut(number) {
                    triangles.drain(from..to);
                }
            });
        }
    }

    fn simplify_numbers(&mut self) {
        let corner = self.best.solids.first().map_or(DVec3::ZERO, |solid| DVec3::from_array(solid.origin));
        if corner != DVec3::ZERO {
            self.attempt(|trial| trial.shift(-corner));
        }
        let mut count = 0;
        self.best.clone().numbers(|_| count += 1);
        for number in 0..count {
            let mut set = |value: &dyn Fn(f64) -> f64| {
                self.attempt(|trial| {
                    let mut at = 0;
                    trial.numbers(|place| {
                        if at == number {
                            *place = value(*place);
                        }
                        at += 1;
                    });
                })
            };
            let _done = set(&|_| 0.0) || DIGITS.iter().any(|&digits| set(&|value| rounded(value, digits)));
        }
    }
}

/// Rounded to decimal digits.
fn rounded(value: f64, digits: usize) -> f64 {
    format!("{:.*e}", digits.saturating_sub(1), value).parse().unwrap_or(value)
}

impl Trial {
    /// Removes objects, and the mention of them in view states.
    fn remove_solids(&mut self, from: usize, to: usize) {
        self.solids.drain(from..to);
        let (from, to) = (from as u32, to as u32);
        let renumber = |set: &ObjectSet| -> ObjectSet {
            let kept = set.iter().filter(|object| !(from..to).contains(object));
            kept.map(|object| if object < to { object } else { object - (to - from) }).collect()
        };
        for frame in &mut self.frames {
            frame.hidden = renumber(&frame.hidden);
            frame.see_through = renumber(&frame.see_through);
            frame.isolated = frame.isolated.as_ref().map(renumber);
        }
    }

    /// Moves everything but sections.
    fn shift(&mut self, by: DVec3) {
        let moved = |place: &mut [f64; 3]| *place = (DVec3::from_array(*place) + by).to_array();
        for solid in &mut self.solids {
            moved(&mut solid.origin);
        }
        for frame in &mut self.frames {
            moved(&mut frame.eye);
            moved(&mut frame.target);
        }
    }

    /// Visits each number that may be another one.
    fn numbers(&mut self, mut visit: impl FnMut(&mut f64)) {
        for frame in &mut self.frames {
            frame.eye.iter_mut().chain(&mut frame.target).for_each(&mut visit);
            [&mut frame.roll, &mut frame.fov, &mut frame.epsilon].into_iter().for_each(&mut visit);
            single(&mut frame.near, &mut visit);
        }
        for solid in &mut self.solids {
            solid.origin.iter_mut().for_each(&mut visit);
            solid.linear.iter_mut().for_each(|place| single(place, &mut visit));
            solid.shape.numbers(&mut visit);
            for (error, shape) in &mut solid.coarser {
                single(error, &mut visit);
                shape.numbers(&mut visit);
            }
        }
    }
}

fn single(place: &mut f32, visit: &mut impl FnMut(&mut f64)) {
    let mut wide = f64::from(*place);
    visit(&mut wide);
    *place = wide as f32;
}

impl Shape {
    fn numbers(&mut self, visit: &mut impl FnMut(&mut f64)) {
        let mut each = |places: &mut [f32]| places.iter_mut().for_each(|place| single(place, visit));
        match self {
            Self::Box { half, .. } => each(half),
            Self::Rectangle { a, b, .. } => {
                each(a);
                each(b);
            }
            Self::Cylinder { radius, half_length, .. } => {
                each(std::slice::from_mut(radius));
                each(std::slice::from_mut(half_length));
            }
            Self::Triangles(triangles) => triangles.iter_mut().flatten().for_each(|corner| each(corner)),
        }
    }

    /// The same in as few triangles as possible.
    fn uncut(&mut self) {
        match self {
            Self::Box { cuts, .. } | Self::Rectangle { cuts, .. } => *cuts = 1,
            Self::Cylinder { sides, .. } => *sides = 3,
            Self::Triangles(_) => {}
        }
    }
}
