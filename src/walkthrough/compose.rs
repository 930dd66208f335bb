//! Makes the frames of a report from records.

use std::{collections::BTreeMap, sync::Arc, time::Duration};

use trimaran_actors::CullerId;
use trimaran_proto::{Camera, CullCounts, DeviceTimes, DrawableId, FrameStats, SentBytes};
use trimaran_scene::Scene;

use super::{objects::count_objects, path::CameraPath};
use crate::report::schema::{CullingCounts, Frame, Machine, Role, RoundCounts, Span};

/// A frame as it was shown.
#[derive(Debug, Clone)]
pub struct FrameRecord {
    /// Its camera.
    pub camera: Camera,
    /// Its culler; none if the display itself culled it.
    pub culler: Option<CullerId>,
    /// The drawables, in the order drawn.
    pub ids: Vec<DrawableId>,
    /// How many of them were drawn only because ids of the frame were lost.
    pub for_loss: u32,
    /// How many drawables of the frame had not come yet, if the display began without the scene: coarser ones
    /// were drawn in their place. 0 if the picture is exact.
    pub lacking: u32,
    /// Whether this is the frame before, shown again after more of it has come.
    pub again: bool,
    /// XXH3-64 of the picture's bytes, if it was read back.
    pub picture: Option<u64>,
    /// When its camera was published; all times are on the display's clock.
    pub published: Duration,
    /// When its begin arrived.
    pub begun: Duration,
    /// When drawing began.
    pub drawing: Duration,
    /// When it was shown.
    pub shown: Duration,
    /// The device's part of drawing it. Zero if it has no timestamps.
    pub on_device: Duration,
    /// The traffic between the display and the frame's culler.
    pub traffic: SentBytes,
    /// Pairs of an id count and the time since the begin: one entry for all batches that came at once.
    pub arrivals: Vec<(u32, Duration)>,
    /// The figures reported by its culler.
    pub stats: Option<FrameStats>,
}

/// Makes a report's frames of records, without the results of an audit.
#[derive(Debug)]
pub(super) struct Composer {
    scene: Arc<Scene>,
    path: CameraPath,
    /// Whether all roles share one clock.
    one_clock: bool,
    /// When each frame so far was first shown.
    shown: Vec<Duration>,
    /// When the last picture was shown.
    last: Option<Duration>,
}

impl Composer {
    /// For the frames after `before`.
    pub(super) fn new(
        scene: &Arc<Scene>,
        path: &CameraPath,
        one_clock: bool,
        before: &[FrameRecord],
    ) -> Self {
        let shown = before.iter().filter(|record| !record.again).map(|record| record.shown).collect();
        let last = before.last().map(|record| record.shown);
        Self { scene: Arc::clone(scene), path: path.clone(), one_clock, shown, last }
    }

    /// The next frame, in the order shown.
    pub(super) fn frame(&mut self, record: &FrameRecord) -> Frame {
        let previous = self.last.replace(record.shown);
        let objects = count_objects(&self.scene, record.ids.iter().copied());
        let frame = Frame {
            objects_drawn: Some(objects),
            timeline: timeline(record, self.one_clock),
            ..frame(&self.scene, &self.path, record, previous)
        };
        if record.again { frame } else { self.shown_first(record, frame) }
    }

    /// Adds figures that a frame has once, however often it is shown: its age and its cost.
    fn shown_first(&mut self, record: &FrameRecord, frame: Frame) -> Frame {
        let frames_between = self.shown.iter().rev().take_while(|shown| **shown > record.published).count();
        self.shown.push(record.shown);
        let bytes = record.traffic + record.stats.map(|stats| stats.to_other).unwrap_or_default();
        Frame {
            latency_frames: u32::try_from(frames_between).ok(),
            latency_ms: Some(milliseconds(record.shown.saturating_sub(record.published))),
            conservatively_visible: conservatively_visible(record),
            bytes: Some(bytes.total()),
            bytes_by_kind: Some(bytes),
            ..frame
        }
    }
}

fn frame(scene: &Scene, path: &CameraPath, record: &FrameRecord, previous: Option<Duration>) -> Frame {
    let number = record.camera.frame();
    let pose = path.pose_of(&record.camera);
    let triangles = record
        .ids
        .iter()
        .filter_map(|id| scene.drawables().get(id.index()))
        .map(|drawable| u64::from(drawable.triangles))
        .sum();
    let stats = record.stats.as_ref();
    let on_device = |of: fn(&DeviceTimes) -> u64| some_time(Duration::from_nanos(of(&stats?.device)));
    Frame {
        frame: number.0,
        eye: pose.map(|p| p.eye().to_array()).unwrap_or_default(),
        forward: pose.map(|p| p.forward().to_array()).unwrap_or_default(),
        up: pose.map(|p| p.up().to_array()).unwrap_or_default(),
        view_state: record.camera.view().0,
        or_ms: stats.map(|s| s.or_busy_ns as f64 * 1e-6),
        hc_ms: stats.map(|s| s.hc_end_ns.saturating_sub(s.hc_start_ns) as f64 * 1e-6),
        rvg_ms: Some(milliseconds(record.shown.saturating_sub(record.drawing))),
        occluders_device_ms: on_device(|times| times.drawing_ns),
        pyramid_device_ms: on_device(|times| times.pyramid_ns),
        culling_device_ms: on_device(|times| times.culling_ns),
        picture_device_ms: some_time(record.on_device),
        frame_ms: previous.map(|previous| milliseconds(record.shown.saturating_sub(previous))),
        lacking: record.lacking.into(),
        again: record.again,
        nodes_drawn: Some(record.ids.len() as u64),
        triangles_drawn: Some(triangles),
        occluders_drawn: stats.map(|s| u64::from(s.occluders)),
        occluder_triangles: stats.map(|s| s.occluder_triangles),
        culling: stats.map(|s| culling(&s.culling)),
        rounds: stats.map(|s| rounds(&s.rounds)),
        culled_by: Some(Machine::of(record.culler)),
        ..Frame::default()
    }
}

/// The busy spans of each role. Unless the clocks are one, the culler's is aligned with the display's where
/// the frame's begin was sent and arrived.
fn timeline(record: &FrameRecord, one_clock: bool) -> Vec<Span> {
    let mut spans = vec![Span {
        role: Role::Rvg,
        machine: Machine::Display,
        start_ms: milliseconds(record.drawing),
        end_ms: milliseconds(record.shown),
    }];
    if let Some(stats) = &record.stats {
        let begun_ns = record.begun.as_nanos() as f64;
        let ahead_ns = if one_clock { 0.0 } else { begun_ns - stats.hc_start_ns as f64 };
        let here = |there_ns: u64| (there_ns as f64 + ahead_ns) * 1e-6;
        let machine = Machine::of(record.culler);
        let span = |role, start, end| Span { role, machine, start_ms: here(start), end_ms: here(end) };
        spans.push(span(Role::Or, busy_start(stats), stats.or_end_ns));
        spans.push(span(Role::Hc, stats.hc_start_ns, stats.hc_end_ns));
    }
    spans
}

/// OR waits for ids before and between its work. The work ends where OR ends, so it is shown there as one
/// piece.
const fn busy_start(stats: &FrameStats) -> u64 {
    stats.or_end_ns.saturating_sub(stats.or_busy_ns)
}

fn culling(counts: &CullCounts) -> CullingCounts {
    CullingCounts {
        nodes_visited: counts.visited.into(),
        nodes_outside: counts.outside.into(),
        boxes_tested: counts.tested.into(),
        boxes_hidden: counts.hidden.into(),
        batches: counts.batches.into(),
        stopped_at_few_pixels: counts.few_pixels.into(),
    }
}

fn rounds(counts: &trimaran_proto::RoundCounts) -> RoundCounts {
    RoundCounts {
        further: counts.further,
        occluder_triangles: counts.occluder_triangles,
        drawing_ms: counts.drawing_ns as f64 * 1e-6,
        boxes_tested: counts.tested.into(),
        nodes_hidden: counts.hidden.into(),
    }
}

/// The drawables drawn because they were not known to be hidden, by reason.
fn conservatively_visible(record: &FrameRecord) -> BTreeMap<String, u64> {
    let culling = record.stats.map(|stats| stats.culling);
    let of_culling = culling.iter().flat_map(|counts| {
        [
            ("near_plane", counts.near_visible),
            ("eye_inside", counts.eye_inside),
            ("not_finite", counts.not_finite),
        ]
    });
    let loss = (record.for_loss > 0).then_some(("loss", record.for_loss));
    of_culling.chain(loss).map(|(reason, count)| (reason.to_owned(), count.into())).collect()
}

/// A time of a device: zero means that it was not measured there.
fn some_time(time: Duration) -> Option<f64> {
    (time > Duration::ZERO).then(|| milliseconds(time))
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use trimaran_cook::{
        CookOptions, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_cull::{LodRule, Viewport};
    use trimaran_proto::{FrameNumber, Settings};

    use super::*;
    use crate::walkthrough::PathChoice;

    #[test]
    fn a_time_of_a_device_that_was_not_measured_is_none() {
        let ms = |nanoseconds: u64| some_time(Duration::from_nanos(nanoseconds));
        assert_eq!([ms(0), ms(500_000), ms(2_500_000)], [None, Some(0.5), Some(2.5)]);
    }

    #[test]
    fn a_frame_shown_again_has_times_of_its_own_and_no_latency_and_no_bytes() {
        let model = plant(&PlantOptions { objects: 20, triangles: 2000, ..PlantOptions::small(5) });
        let scene = Arc::new(cook(&model, &CookOptions::default(), &()).unwrap());
        let views = Settings::new(Viewport::new(64, 64).unwrap(), LodRule::new(2.0).unwrap()).into();
        let path = CameraPath::find(&PathChoice::Auto { seed: 1 }, &scene, views, Some(2)).unwrap();
        let ms = Duration::from_millis;
        let record =
            |number: u32, pose: usize, [published, shown]: [u64; 2], lacking, again: bool| FrameRecord {
                camera: path.all()[pose].for_frame(FrameNumber(number)),
                culler: CullerId::of(0),
                ids: vec![DrawableId(0)],
                for_loss: u32::from(number > 0),
                lacking,
                again,
                picture: None,
                published: ms(published),
                begun: ms(published),
                drawing: ms(shown - 1),
                shown: ms(shown),
                on_device: Duration::ZERO,
                traffic: SentBytes { ids: if again { 0 } else { 12 }, ..SentBytes::default() },
                arrivals: Vec::new(),
                stats: None,
            };
        let records = [
            record(0, 0, [10, 20], 3, false),
            record(1, 0, [10, 25], 1, true),
            record(2, 0, [10, 31], 0, true),
            record(3, 1, [15, 40], 0, false),
        ];
        let figures = |frame: &Frame| (frame.frame_ms, frame.latency_ms, frame.latency_frames, frame.bytes);
        // A resumed walk reports the same as an uninterrupted one.
        for before in 0..records.len() {
            let mut composer = Composer::new(&scene, &path, false, &records[..before]);
            let frames: Vec<_> = records[before..].iter().map(|record| composer.frame(record)).collect();
            let expected = [
                (None, Some(10.0), Some(0), Some(12)),
                (Some(5.0), None, None, None),
                (Some(6.0), None, None, None),
                (Some(9.0), Some(25.0), Some(1), Some(12)),
            ];
            assert_eq!(frames.iter().map(figures).collect::<Vec<_>>(), expected[before..], "{before}");
            let said: Vec<_> = frames.iter().map(|frame| (frame.lacking, frame.again)).collect();
            assert_eq!(said, [(3, false), (1, true), (0, true), (0, false)][before..]);
            let lost: u64 = frames.iter().filter_map(|frame| frame.conservatively_visible.get("loss")).sum();
            assert_eq!(lost, 1, "what was drawn for loss counts once");
            assert!(frames.iter().all(|frame| frame.bytes == frame.bytes_by_kind.map(|kinds| kinds.total())));
        }
    }
}
