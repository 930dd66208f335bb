//! What three machines would show: a model, made of the times that roles took while no other role computed.

use serde::{Deserialize, Serialize};

use super::Frame;

/// Pictures a second that three machines would show, one for each culler and one for the display. Each is
/// like the one that the times were taken on, and the network between them takes no time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Pictures a second, from the first to the last.
    pub fps: f64,
    /// The error, as far as it can be measured: `fps` if all of `unaccounted_ms` came on top of each frame.
    pub fps_at_least: f64,
    /// The walk's time that is in no role's busy time, a frame: taking messages, waking threads, noting what
    /// was shown.
    pub unaccounted_ms: f64,
    /// What a second culler could bring at most: `fps` if OR drew while HC culls the frame before. One
    /// culler that does OR and HC of every frame has `fps` as well.
    pub fps_overlapped: f64,
}

/// What each role takes for a frame, milliseconds.
#[derive(Debug, Clone, Copy)]
struct Times {
    or: f64,
    hc: f64,
    rvg: f64,
}

/// When OR of a frame may begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Schedule {
    /// When HC of the frame before is complete: OR chooses among all that it found.
    AfterCulling,
    /// When HC of the frame before begins: the most that drawing as ids come could gain.
    WithCulling,
}

impl Model {
    /// Of roles that computed one after another, whose walk took `wall_ms` from the first picture to the
    /// last. None where there are no two pictures.
    pub(super) fn of(frames: &[Frame], wall_ms: Option<f64>) -> Option<Self> {
        let times: Vec<Times> = frames.iter().filter_map(Times::of).collect();
        let busy: f64 = times.iter().map(|Times { or, hc, rvg }| or + hc + rvg).sum();
        // Work on the first frame began when its camera was handed out.
        let whole = wall_ms? + frames.first()?.latency_ms?;
        let unaccounted_ms = (whole - busy).max(0.0) / frames.len() as f64;
        let fps = fps(&times, Schedule::AfterCulling)?;
        Some(Self {
            fps,
            fps_at_least: 1000.0 / (1000.0 / fps + unaccounted_ms),
            unaccounted_ms,
            fps_overlapped: self::fps(&times, Schedule::WithCulling)?,
        })
    }
}

impl Times {
    fn of(frame: &Frame) -> Option<Self> {
        Some(Self { or: frame.or_ms?, hc: frame.hc_ms?, rvg: frame.rvg_ms? })
    }
}

fn fps(times: &[Times], schedule: Schedule) -> Option<f64> {
    let shown = shown(times, schedule);
    let [first, .., last] = *shown else { return None };
    (last > first).then(|| 1000.0 * (shown.len() - 1) as f64 / (last - first))
}

/// When each picture is shown, milliseconds after the first camera.
///
/// The display hands out a frame's camera when it takes up the frame two before, and takes that up when it
/// has shown the one before it. So the cullers are at most two frames ahead of the frame that is drawn.
fn shown(times: &[Times], schedule: Schedule) -> Vec<f64> {
    let (mut began, mut culled) = (0.0_f64, 0.0_f64);
    let mut shown: Vec<f64> = Vec::with_capacity(times.len());
    for (frame, &Times { or, hc, rvg }) in times.iter().enumerate() {
        let camera = frame.checked_sub(3).and_then(|three_before| shown.get(three_before)).copied();
        let fed = if schedule == Schedule::AfterCulling { culled } else { began };
        let occluded = fed.max(camera.unwrap_or(0.0)) + or;
        began = occluded.max(culled);
        culled = began + hc;
        let before = shown.last().copied().unwrap_or(0.0);
        shown.push(culled.max(before) + rvg);
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
    fn steady([or, hc, rvg]: [f64; 3]) -> Model {
        let frames = table(&[[or, hc, rvg]; 100]);
        Model::of(&frames, Some(99.0 * (or + hc + rvg))).unwrap()
    }

    #[test]
    fn the_pair_or_the_display_bounds_the_rate() {
        let pair = steady([10.0, 15.0, 5.0]);
        assert_eq!((pair.fps, pair.fps_at_least, pair.unaccounted_ms), (40.0, 40.0, 0.0), "OR + HC");
        assert!((pair.fps_overlapped - 1000.0 / 15.0).abs() < 0.5, "max(OR, HC): {}", pair.fps_overlapped);
        let display = steady([10.0, 15.0, 50.0]);
        assert_eq!((display.fps, display.fps_overlapped), (20.0, 20.0), "RVG");
    }

    #[test]
    fn time_that_no_role_accounts_for_is_the_models_error() {
        let frames = table(&[[10.0, 10.0, 10.0]; 10]);
        // 300 ms of work; the walk took 30 from the first camera to its picture, and 320 more.
        let model = Model::of(&frames, Some(320.0)).unwrap();
        assert_eq!((model.fps, model.unaccounted_ms), (50.0, 5.0));
        assert_eq!(model.fps_at_least, 40.0);
    }

    #[test]
    fn nothing_is_modelled_of_frames_whose_times_are_not_known() {
        let partial = Frame { or_ms: Some(1.0), latency_ms: Some(1.0), ..Frame::default() };
        assert_eq!(Model::of(&[partial.clone(), partial], Some(1.0)), None);
        assert_eq!(Model::of(&table(&[[1.0; 3]]), None), None, "one picture has no rate");
        assert_eq!(Model::of(&[], None), None);
    }
}
