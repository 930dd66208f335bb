//! The figures that a machine for each role would show: a model, made of the times that roles took while no
//! other role computed.

use serde::{Deserialize, Serialize};
use trimaran_actors::Schedule;

use super::{Frame, Report, Run, Stat};

/// Pictures a second that a machine for each culler and one for the display would show. Each is like the one
/// that the times were taken on, and the network between them takes no time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Pictures a second, from the first to the last.
    pub fps: f64,
    /// The error, as far as it can be measured: `fps` if all of `unaccounted_ms` came on top of each frame.
    pub fps_at_least: f64,
    /// Time from handing a camera out to its picture, median, milliseconds.
    pub latency_ms: f64,
    /// The walk's time that is in no role's busy time, a frame: taking messages, waking threads, noting what
    /// was shown.
    pub unaccounted_ms: f64,
}

/// The time of each role for a frame, milliseconds.
#[derive(Debug, Clone, Copy)]
struct Times {
    or: f64,
    hc: f64,
    rvg: f64,
}

impl Model {
    /// Of the roles of `run`, which computed one after another, and whose walk took `wall_ms` from the first
    /// picture to the last. None where there are no two pictures.
    pub(super) fn of(run: &Run, frames: &[Frame], wall_ms: Option<f64>) -> Option<Self> {
        let times: Vec<Times> = frames.iter().filter_map(Times::of).collect();
        let busy: f64 = times.iter().map(|Times { or, hc, rvg }| or + hc + rvg).sum();
        // Work on the first frame began when its camera was handed out.
        let whole = wall_ms? + frames.first()?.latency_ms?;
        let unaccounted_ms = (whole - busy).max(0.0) / frames.len() as f64;
        let switch = run.schedule == Schedule::Switch.name();
        let frames = frames_of(&times, run.cullers as usize, switch);
        let fps = fps(&frames)?;
        let latency_ms = Stat::of(frames.iter().map(|frame| frame.shown - frame.dealt))?.median;
        let fps_at_least = 1000.0 / (1000.0 / fps + unaccounted_ms);
        Some(Self { fps, fps_at_least, latency_ms, unaccounted_ms })
    }
}

impl Report {
    /// Time from the picture before to each one's as modelled, milliseconds: of a walk whose roles computed
    /// one after another. None of a frame whose times are not known.
    #[must_use]
    pub fn modelled_intervals_ms(&self) -> Vec<Option<f64>> {
        let times: Option<Vec<Times>> = self.frames.iter().map(Times::of).collect();
        let (Some(times), true) = (times, self.run.alone) else { return vec![None; self.frames.len()] };
        let switch = self.run.schedule == Schedule::Switch.name();
        let frames = frames_of(&times, self.run.cullers as usize, switch);
        let shown = frames.iter().map(|frame| frame.shown);
        let before = std::iter::once(0.0).chain(shown.clone());
        shown.zip(before).map(|(shown, before)| Some(shown - before)).collect()
    }
}

impl Times {
    fn of(frame: &Frame) -> Option<Self> {
        Some(Self { or: frame.or_ms?, hc: frame.hc_ms?, rvg: frame.rvg_ms? })
    }
}

/// When what happens to a frame, milliseconds after the first camera.
#[derive(Debug, Clone, Copy)]
struct Modelled {
    /// Its camera is handed out.
    dealt: f64,
    /// HC begins.
    began: f64,
    culled: f64,
    /// RVG begins.
    drawing: f64,
    shown: f64,
}

fn fps(frames: &[Modelled]) -> Option<f64> {
    let [first, .., last] = frames else { return None };
    (last.shown > first.shown).then(|| 1000.0 * (frames.len() - 1) as f64 / (last.shown - first.shown))
}

/// The times of each frame in lockstep.
///
/// A culler has the camera of its next frame while it culls one, but none is as much as twice the number of
/// cullers ahead of the last picture. The display deals between two pictures, and not while it draws one. In
/// the schedule `switch` OR draws what HC of the frame before finds while it does, so it is complete no
/// sooner.
fn frames_of(times: &[Times], cullers: usize, switch: bool) -> Vec<Modelled> {
    let mut frames: Vec<Modelled> = Vec::with_capacity(times.len());
    for (frame, &Times { or, hc, rvg }) in times.iter().enumerate() {
        let before = |by: usize, when: fn(&Modelled) -> f64| {
            frame.checked_sub(by).and_then(|earlier| frames.get(earlier)).map_or(0.0, when)
        };
        let last = before(1, |frame| frame.shown);
        let (dealt, began) = if cullers == 0 {
            (last, last + or)
        } else {
            let wanted = before(cullers, |frame| frame.began).max(before(2 * cullers, |frame| frame.shown));
            let mut pictures = frames.iter().rev().take_while(|frame| frame.shown > wanted);
            let dealt = pictures.find(|frame| frame.drawing < wanted).map_or(wanted, |frame| frame.shown);
            let free = before(cullers, |frame| frame.culled).max(dealt);
            let (fed, complete) = match switch {
                true => (before(1, |frame| frame.began), before(1, |frame| frame.culled)),
                false => (0.0, 0.0),
            };
            (dealt, (free.max(fed) + or).max(complete))
        };
        let culled = began + hc;
        let drawing = culled.max(last);
        frames.push(Modelled { dealt, began, culled, drawing, shown: drawing + rvg });
    }
    frames
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(times: &[[f64; 3]]) -> Vec<Frame> {
        let frame = |&[or, hc, rvg]: &[f64; 3]| Frame {
            or_ms: Some(or),
            hc_ms: Some(hc),
            rvg_ms: Some(rvg),
            latency_ms: Some(or + hc + rvg),
            ..Frame::default()
        };
        times.iter().map(frame).collect()
    }

    /// The model of frames that all take the same, whose roles accounted for all of the time.
    fn steady([or, hc, rvg]: [f64; 3], run: &Run) -> Model {
        let frames = table(&[[or, hc, rvg]; 1000]);
        Model::of(run, &frames, Some(999.0 * (or + hc + rvg))).unwrap()
    }

    fn run(cullers: u32, schedule: &str) -> Run {
        Run { cullers, schedule: schedule.to_owned(), ..Run::default() }
    }

    #[test]
    fn cullers_or_the_display_bound_the_rate() {
        let fps = |times, cullers, schedule| steady(times, &run(cullers, schedule)).fps;
        let about = |fps: f64, expected: f64| assert!((fps / expected - 1.0).abs() < 0.005, "{fps}");
        let slow_culling = [10.0, 15.0, 5.0];
        about(fps(slow_culling, 0, "independent"), 1000.0 / 30.0);
        about(fps(slow_culling, 1, "independent"), 1000.0 / 25.0);
        about(fps(slow_culling, 2, "independent"), 2000.0 / 25.0);
        about(fps(slow_culling, 2, "switch"), 1000.0 / 15.0);
        about(fps(slow_culling, 8, "independent"), 1000.0 / 5.0);
        about(fps([10.0, 15.0, 50.0], 1, "independent"), 1000.0 / 50.0);
    }

    #[test]
    fn time_that_no_role_accounts_for_is_the_models_error() {
        let frames = table(&[[10.0, 10.0, 10.0]; 10]);
        // 300 ms of work; the walk took 30 from the first camera to its picture, and 320 more.
        let model = Model::of(&run(1, "independent"), &frames, Some(320.0)).unwrap();
        assert_eq!((model.fps, model.unaccounted_ms), (50.0, 5.0));
        assert_eq!(model.fps_at_least, 40.0);
    }

    #[test]
    fn nothing_is_modelled_of_frames_whose_times_are_not_known() {
        let partial = Frame { or_ms: Some(1.0), latency_ms: Some(1.0), ..Frame::default() };
        assert_eq!(Model::of(&Run::default(), &[partial.clone(), partial], Some(1.0)), None);
        assert_eq!(Model::of(&Run::default(), &table(&[[1.0; 3]]), None), None, "one picture has no rate");
        assert_eq!(Model::of(&Run::default(), &[], None), None);
    }
}
