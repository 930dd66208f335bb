//! The frames' figures, condensed.

use std::{collections::BTreeMap, ops::Add};

use serde::{Deserialize, Serialize};
use trimaran_cull::SURFACE_SLACK_PX;

use crate::{culling::CullingMethod, report::FrameLoad};

use super::{
    Ended, FalseCull, FalseCullCause, Frame, Loading, LowStat, METRICS, Model, Run, SentBytes, Stat,
};

/// Objects drawn over objects exactly visible in the paper's power plant (its tables 2 and 3).
pub const PAPER_OBJECT_TIGHTNESS: f64 = 1.83;
/// Polygons drawn over polygons exactly visible in the paper's power plant (its tables 2 and 3).
pub const PAPER_TRIANGLE_TIGHTNESS: f64 = 12.2;

/// The frames' figures, condensed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Frames shown.
    pub frames: u32,
    /// How the walk ended.
    pub ended: Ended,
    /// Frames that the display drew with all that was in the frustum, because occlusion culling would have
    /// cost more.
    #[serde(default)]
    pub not_culled_frames: u32,
    /// Frames compared with the unculled picture of the same LOD cut.
    pub audited_frames: u32,
    /// Time from the first picture shown to the last, milliseconds.
    pub wall_ms: Option<f64>,
    /// Frames a second as measured on this machine, over `wall_ms`.
    pub measured_fps: Option<f64>,
    /// The figures that a machine for each culler and one for the display would show: a model, not a
    /// measurement. None unless the roles computed one after another.
    pub model: Option<Model>,
    /// How much more than the exactly visible was drawn.
    pub tightness: Tightness,
    /// Drawables falsely culled, summed over the audited frames; `null` if none was audited.
    pub false_culled_nodes_total: Option<u64>,
    /// Pixels falsely culled, summed over the audited frames.
    pub false_culled_pixels_total: Option<u64>,
    /// Pixels unlike the unculled LOD cut, summed over the audited frames.
    pub cut_mismatch_pixels_total: Option<u64>,
    /// The false culls by cause, summed over the audited frames.
    pub false_culls: Vec<FalseCull>,
    /// Pictures that were shown before all of them had come; `null` where there were none.
    #[serde(default)]
    pub loading: Option<Loading>,
    /// The silhouette's deviation against the claimed bound; `null` if it was not measured.
    pub silhouette: Option<DeviationVerdict>,
    /// The surfaces' deviation, likewise.
    pub surfaces: Option<DeviationVerdict>,
    /// PSNR against full detail, decibels.
    pub psnr_db: Option<LowStat>,
    /// Nodes drawn because a test could not be decided, by reason, summed over all frames.
    pub conservatively_visible: BTreeMap<String, u64>,
    /// Bytes by kind, summed over all frames on which they were counted.
    pub bytes_by_kind: Option<SentBytes>,
    /// Bytes a frame as counted, beside the two formulas.
    pub bandwidth: Option<Bandwidth>,
    /// Median, 95th percentile and maximum of every figure of [`METRICS`] that was measured.
    pub metrics: BTreeMap<String, Stat>,
}

/// How much more than the exactly visible was drawn: medians over the audited frames, beside the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tightness {
    /// Nodes drawn over nodes exactly visible at the same LOD cut, median.
    pub nodes: Option<f64>,
    /// Objects drawn over objects exactly visible at the same LOD cut, median.
    pub objects: Option<f64>,
    /// Triangles drawn over triangles exactly visible at the same LOD cut, median.
    pub triangles: Option<f64>,
    /// [`PAPER_OBJECT_TIGHTNESS`].
    pub paper_objects: f64,
    /// [`PAPER_TRIANGLE_TIGHTNESS`].
    pub paper_triangles: f64,
}

/// Bytes a frame as counted, beside the two formulas evaluated at what was measured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bandwidth {
    /// Ids a frame and receiver (n), mean.
    pub ids_per_frame: f64,
    /// The most ids in one message (b).
    pub batch: u32,
    /// Header bytes a message (h), mean.
    pub header_bytes: f64,
    /// Receivers of the ids (r).
    pub receivers: u8,
    /// Bytes a frame as counted, mean.
    pub measured_bytes: f64,
    /// The paper's formula, bytes a frame: 8nh/b + 3(72 + h). It multiplies id bytes by header bytes.
    pub paper_formula_bytes: f64,
    /// The bytes really sent, per frame: r(4n + hn/b) + (r + 1)(72 + h).
    pub corrected_formula_bytes: f64,
}

/// A largest deviation from full detail, against the bound that was claimed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DeviationVerdict {
    /// The largest deviation of all audited frames, pixels.
    pub max_px: f64,
    /// The bound, pixels.
    pub epsilon_px: f64,
    /// [`SURFACE_SLACK_PX`]: how exactly it is known where a surface lies, pixels.
    pub resolution_px: f64,
    /// Whether the deviation is at most the bound, as far as that can be resolved.
    pub within_epsilon: bool,
}

impl DeviationVerdict {
    fn of(largest: Option<&Stat>, epsilon_px: f64) -> Option<Self> {
        let max_px = largest?.max;
        let resolution_px = SURFACE_SLACK_PX;
        let within_epsilon = max_px <= epsilon_px + resolution_px;
        Some(Self { max_px, epsilon_px, resolution_px, within_epsilon })
    }
}

impl Summary {
    /// Condenses `frames`; `wall_ms` is the time from the first picture shown to the last.
    #[must_use]
    pub fn of(run: &Run, frames: &[Frame], wall_ms: Option<f64>, ended: Ended) -> Self {
        let metrics: BTreeMap<String, Stat> = METRICS
            .iter()
            .filter_map(|m| Some((m.key.to_owned(), Stat::of(frames.iter().filter_map(m.of))?)))
            .collect();
        let median = |key: &str| metrics.get(key).map(|s| s.median);
        // Another method was asked for, and is no choice.
        let may_choose = run.culling == CullingMethod::Trimaran;
        let not_culled = frames.iter().filter(|f| may_choose && f.is_not_culled()).count();
        let audited = frames.iter().filter(|f| f.cut_mismatch_pixels.is_some()).count();
        Self {
            frames: u32::try_from(frames.len()).unwrap_or(u32::MAX),
            ended,
            not_culled_frames: u32::try_from(not_culled).unwrap_or(u32::MAX),
            audited_frames: u32::try_from(audited).unwrap_or(u32::MAX),
            wall_ms,
            measured_fps: measured_fps(frames.len(), wall_ms),
            model: run.alone.then(|| Model::of(run, frames, wall_ms)).flatten(),
            tightness: Tightness {
                nodes: median("node_tightness"),
                objects: median("object_tightness"),
                triangles: median("triangle_tightness"),
                paper_objects: PAPER_OBJECT_TIGHTNESS,
                paper_triangles: PAPER_TRIANGLE_TIGHTNESS,
            },
            false_culled_nodes_total: sum(frames, |f| f.false_culled_nodes),
            false_culled_pixels_total: sum(frames, |f| f.false_culled_pixels),
            cut_mismatch_pixels_total: sum(frames, |f| f.cut_mismatch_pixels),
            false_culls: false_culls(frames),
            loading: Loading::of(frames),
            silhouette: DeviationVerdict::of(metrics.get("silhouette_max_px"), run.epsilon_px),
            surfaces: DeviationVerdict::of(metrics.get("surface_max_px"), run.epsilon_px),
            psnr_db: LowStat::of_psnr(frames),
            conservatively_visible: conservatively_visible(frames),
            bytes_by_kind: bytes_by_kind(frames),
            bandwidth: Bandwidth::of(run, frames),
            metrics,
        }
    }

    /// Whether frames were audited, but none that was exact.
    #[must_use]
    pub fn audits_only_loading(&self) -> bool {
        self.audited_frames == 0 && self.loading.is_some_and(|loading| loading.audited_frames > 0)
    }
}

impl Bandwidth {
    fn of(run: &Run, frames: &[Frame]) -> Option<Self> {
        let counted: Vec<(&SentBytes, f64)> =
            frames.iter().filter_map(|f| Some((f.bytes_by_kind.as_ref()?, f.nodes_drawn? as f64))).collect();
        let mean = |total: f64| total / counted.len() as f64;
        let messages: u64 = counted.iter().map(|(b, _)| b.messages).sum();
        if counted.is_empty() || messages == 0 || run.batch == 0 {
            return None;
        }
        let headers: u64 = counted.iter().map(|(b, _)| b.headers).sum();
        let (n, h) = (mean(counted.iter().map(|(_, n)| n).sum()), headers as f64 / messages as f64);
        let receivers = run.receivers();
        let load = FrameLoad { ids: n, batch: f64::from(run.batch), header: h, receivers };
        Some(Self {
            ids_per_frame: n,
            batch: run.batch,
            header_bytes: h,
            receivers,
            measured_bytes: mean(counted.iter().map(|(b, _)| (b.total() - b.geometry) as f64).sum()),
            paper_formula_bytes: load.paper_bytes(),
            corrected_formula_bytes: load.sent_bytes(),
        })
    }
}

fn measured_fps(frames: usize, wall_ms: Option<f64>) -> Option<f64> {
    let wall_ms = wall_ms.filter(|&w| w > 0.0 && frames > 1)?;
    Some(1000.0 * (frames - 1) as f64 / wall_ms)
}

pub(super) fn sum(frames: &[Frame], of: impl Fn(&Frame) -> Option<u64>) -> Option<u64> {
    frames.iter().filter_map(of).reduce(u64::saturating_add)
}

fn false_culls(frames: &[Frame]) -> Vec<FalseCull> {
    let total = |cause: FalseCullCause| {
        frames.iter().flat_map(|f| &f.false_culls).filter(|c| c.cause == cause).fold(
            FalseCull { cause, nodes: 0, pixels: 0 },
            |sum, c| FalseCull { cause, nodes: sum.nodes + c.nodes, pixels: sum.pixels + c.pixels },
        )
    };
    FalseCullCause::ALL.into_iter().map(total).filter(|c| c.nodes + c.pixels > 0).collect()
}

fn conservatively_visible(frames: &[Frame]) -> BTreeMap<String, u64> {
    let mut total = BTreeMap::new();
    for (reason, nodes) in frames.iter().flat_map(|f| &f.conservatively_visible) {
        *total.entry(reason.clone()).or_insert(0) += nodes;
    }
    total
}

fn bytes_by_kind(frames: &[Frame]) -> Option<SentBytes> {
    frames.iter().filter_map(|f| f.bytes_by_kind).reduce(Add::add)
}

#[cfg(test)]
mod tests {
    use trimaran_actors::CullerId;

    use super::*;
    use crate::report::{
        sample,
        schema::{CullingCounts, Machine},
    };

    #[test]
    fn what_was_not_measured_is_not_zero() {
        let summary =
            Summary::of(&sample::run(), &[Frame::default(), Frame::default()], None, Ended::default());
        assert_eq!(summary.frames, 2);
        assert_eq!(summary.audited_frames, 0);
        assert!(summary.metrics.is_empty());
        assert_eq!(summary.false_culled_pixels_total, None);
        assert_eq!(summary.measured_fps, None);
        assert_eq!(summary.model, None);
        assert_eq!(summary.bandwidth, None);
        assert_eq!(summary.loading, None);
        assert_eq!((summary.silhouette, summary.surfaces), (None, None));
        assert_eq!(summary.psnr_db, None);
    }

    #[test]
    fn only_times_taken_alone_make_a_model() {
        let times = [(10.0, 20.0, 5.0), (30.0, 10.0, 5.0)];
        let frames: Vec<Frame> = times
            .iter()
            .map(|&(or, hc, rvg)| Frame {
                or_ms: Some(or),
                hc_ms: Some(hc),
                rvg_ms: Some(rvg),
                latency_ms: Some(or + hc + rvg),
                ..Frame::default()
            })
            .collect();
        let summary =
            |alone| Summary::of(&Run { alone, ..sample::run() }, &frames, Some(100.0), Ended::default());
        assert_eq!(summary(false).measured_fps, Some(10.0), "two pictures 100 ms apart");
        assert_eq!(summary(false).model, None, "they hold other roles' work");
        assert_eq!(summary(true).model.unwrap().fps, 100.0, "pictures after 10 + 20 + 5 and 30 + 10 + 5 ms");
    }

    #[test]
    fn tightness_is_of_audited_frames_with_something_to_see() {
        let frame = |drawn, exact| Frame { nodes_drawn: Some(drawn), nodes_exact: exact, ..Frame::default() };
        let frames = [frame(30, Some(20)), frame(1000, None), frame(5, Some(0))];
        let summary = Summary::of(&sample::run(), &frames, None, Ended::default());
        assert_eq!(summary.tightness.nodes, Some(1.5));
        assert_eq!(summary.metrics["node_tightness"].frames, 1);
        assert_eq!(summary.metrics["nodes_drawn"].frames, 3);
    }

    #[test]
    fn bandwidth_is_evaluated_at_what_was_measured() {
        let frame = |drawn: u64, headers, messages| Frame {
            nodes_drawn: Some(drawn),
            bytes_by_kind: Some(SentBytes { ids: 8 * drawn, headers, messages, ..SentBytes::default() }),
            ..Frame::default()
        };
        let run = Run { batch: 100, schedule: "switch".to_owned(), ..sample::run() };
        let bandwidth = Bandwidth::of(&run, &[frame(100, 40, 4), frame(300, 60, 6)]).unwrap();
        assert_eq!((bandwidth.ids_per_frame, bandwidth.header_bytes), (200.0, 10.0));
        assert_eq!(bandwidth.measured_bytes, 1650.0);
        assert_eq!(bandwidth.corrected_formula_bytes, 2.0 * (800.0 + 20.0) + 3.0 * 82.0);
        assert_eq!(bandwidth.paper_formula_bytes, 160.0 + 3.0 * 82.0);
    }

    #[test]
    fn deviations_are_held_against_epsilon() {
        let within = |max| {
            let stat = Stat::of([0.5, max]).unwrap();
            DeviationVerdict::of(Some(&stat), 2.0).unwrap().within_epsilon
        };
        assert_eq!([within(2.0), within(2.0 + SURFACE_SLACK_PX), within(2.1)], [true, true, false]);
        assert_eq!(DeviationVerdict::of(None, 2.0), None);
    }

    #[test]
    fn frames_are_not_culled_if_the_display_looked_at_nothing() {
        let counts = |nodes_visited, boxes_tested| {
            Some(CullingCounts { nodes_visited, boxes_tested, ..CullingCounts::default() })
        };
        let frame =
            |culler, culling| Frame { culled_by: Some(Machine::of(culler)), culling, ..Frame::default() };
        let frames = [
            frame(None, counts(0, 0)),
            frame(None, counts(1, 0)),
            frame(None, counts(0, 1)),
            frame(None, None),
            // Another session has culled it.
            frame(CullerId::of(0), counts(0, 0)),
        ];
        let summary = Summary::of(&sample::run(), &frames, None, Ended::default());
        assert_eq!(summary.not_culled_frames, 1);
        let asked_for = Run { culling: CullingMethod::Frustum, ..sample::run() };
        assert_eq!(Summary::of(&asked_for, &frames, None, Ended::default()).not_culled_frames, 0);
    }

    #[test]
    fn false_culls_are_summed_by_cause() {
        let summary = sample::report().summary;
        let causes: Vec<_> = summary.false_culls.iter().map(|c| (c.cause, c.nodes, c.pixels)).collect();
        let expected = [(FalseCullCause::MissedSamples, 2, 11), (FalseCullCause::Unattributed, 1, 30)];
        assert_eq!(causes, expected);
        assert_eq!(summary.false_culled_pixels_total, Some(41));
        assert_eq!(summary.audited_frames, 19, "one of 20 was still loading");
        assert_eq!(summary.conservatively_visible["near_plane"], 232, "what is shown again counts once");
    }

    #[test]
    fn pictures_shown_again_and_not_exact_yet_leave_other_figures_alone() {
        let report = sample::report();
        let (loading, rest): (Vec<_>, Vec<_>) =
            report.frames.iter().cloned().partition(|frame| frame.again || frame.lacking > 0);
        assert_eq!(loading.len(), 3);
        let first = loading.iter().filter(|frame| !frame.again).cloned();
        let of = |frames: &[Frame]| Summary::of(&report.run, frames, None, Ended::default());
        let (all, without) = (of(&report.frames), of(&rest));
        let once = of(&rest.iter().cloned().chain(first).collect::<Vec<_>>());
        assert_eq!((all.frames, without.frames), (60, 57));
        assert_eq!(all.bandwidth.unwrap().measured_bytes, once.bandwidth.unwrap().measured_bytes);
        for key in ["latency_ms", "latency_frames", "bytes", "or_ms", "hc_ms"] {
            assert_eq!(all.metrics[key], once.metrics[key], "{key}");
        }
        for key in
            ["cut_mismatch_pixels", "false_culled_pixels", "node_tightness", "flip_mean", "surface_max_px"]
        {
            assert_eq!(all.metrics[key], without.metrics[key], "{key}");
        }
        assert_eq!((all.surfaces, all.psnr_db), (without.surfaces, without.psnr_db));
        assert_eq!(all.metrics["frame_ms"].frames, 59, "pictures have times");
        assert_eq!((all.metrics["loading_pixels"].frames, without.loading), (1, None));
    }
}
