//! What a machine for each role would show: a model, made of the times that roles took while no other role
//! computed.

use serde::{Deserialize, Serialize};
use trimaran_actors::Schedule;

use super::{Frame, Run};

/// Pictures a second that a machine for each culler and one for the display would show. Each is like the one
/// that the times were taken on, and the network between them takes no time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Pictures a second, from the first to the last.
    pub fps: f64,
    /// The error, as far as it can be measured: `fps` if all of `unaccounted_ms` came on top of each frame.
    pub fps_at_least: f64,
    /// The walk's time that is in no role's busy time, a frame: taking messages, waking threads, noting what
    /// was shown.
    pub unaccounted_ms: f64,
}

/// What each role takes for a frame, milliseconds.
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
        let fps = fps(&times, run.cullers as usize, switch)?;
        Some(Self { fps, fps_at_least: 1000.0 / (1000.0 / fps + unaccounted_ms), unaccounted_ms })
    }
}

impl Times {
    fn of(frame: &Frame) -> Option<Self> {
        Some(Self { or: frame.or_ms?, hc: frame.hc_ms?, rvg: frame.rvg_ms? })
    }
}

fn fps(times: &[Times], cullers: usize, switch: bool) -> Option<f64> {
    let shown = shown(times, cullers, switch);
    let [first, .., last] = *shown else { return None };
    (last > first).then(|| 1000.0 * (shown.len() - 1) as f64 / (last - first))
}

/// When each picture is shown, milliseconds after the first camera, in lockstep.
///
/// A culler has the camera of its next frame while it culls one, but none is as much as twice the number of
/// cullers ahead of the last picture. The display deals between two pictures, and not while it draws one. In
/// the schedule `switch` OR draws what HC of the frame before finds while it does, so it is complete no
/// sooner.
fn shown(times: &[Times], cullers: usize, switch: bool) -> Vec<f64> {
    let mut began: Vec<f64> = Vec::with_capacity(times.len());
    let mut culled: Vec<f64> = Vec::with_capacity(times.len());
    let mut drawing: Vec<f64> = Vec::with_capacity(times.len());
    let mut shown: Vec<f64> = Vec::with_capacity(times.len());
    let before = |done: &[f64], frame: usize, by: usize| {
        frame.checked_sub(by).and_then(|earlier| done.get(earlier)).copied().unwrap_or(0.0)
    };
    for (frame, &Times { or, hc, rvg }) in times.iter().enumerate() {
        let last = before(&shown, frame, 1);
        let occluded = if cullers == 0 {
            last + or
        } else {
            let wanted = before(&began, frame, cullers).max(before(&shown, frame, 2 * cullers));
            let pictures = drawing.iter().zip(&shown).rev();
            let drawn_then =
                pictures.take_while(|(_, end)| **end > wanted).find(|(start, _)| **start < wanted);
            let dealt = drawn_then.map_or(wanted, |(_, end)| *end);
            let free = before(&culled, frame, cullers).max(dealt);
            let (fed, complete) =
                if switch { (before(&began, frame, 1), before(&culled, frame, 1)) } else { (0.0, 0.0) };
            (free.max(fed) + or).max(complete)
        };
        began.push(occluded);
        culled.push(occluded + hc);
        drawing.push((occluded + hc).max(last));
        shown.push((occluded + hc).max(last) + rvg);
    }
    shown
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
