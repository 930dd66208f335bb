//! From what was recorded to the frames of a report.

use std::{collections::BTreeMap, sync::Arc, time::Duration};

use trimaran_actors::CullerId;
use trimaran_proto::{Camera, CullCounts, DrawableId, FrameStats, SentBytes};
use trimaran_scene::Scene;

use super::{objects::count_objects, path::CameraPath};
use crate::report::schema::{CullingCounts, Frame, Machine, Role, RoundCounts, Span};

/// A frame as it was shown.
#[derive(Debug, Clone)]
pub struct FrameRecord {
    /// Its camera.
    pub camera: Camera,
    /// Who culled it; none if the display itself did.
    pub culler: Option<CullerId>,
    /// What was drawn, in the order drawn.
    pub ids: Vec<DrawableId>,
    /// How many of them were drawn only because ids of the frame were lost.
    pub for_loss: u32,
    /// XXH3-64 of the picture's bytes, if it was read back.
    pub picture: Option<u64>,
    /// When its camera was handed out; all times are on the display's clock.
    pub published: Duration,
    /// When its begin arrived.
    pub begun: Duration,
    /// When drawing began.
    pub drawing: Duration,
    /// When it was shown.
    pub shown: Duration,
    /// What travelled between the display and the frame's culler.
    pub traffic: SentBytes,
    /// How many ids had come, and when, since the begin: one entry for all batches that came at once.
    pub arrivals: Vec<(u32, Duration)>,
    /// What that machine says it did.
    pub stats: Option<FrameStats>,
}

/// Makes the report's frames of what was recorded, without what only an audit can tell.
#[derive(Debug)]
pub(super) struct Composer {
    scene: Arc<Scene>,
    path: CameraPath,
    /// Whether all roles measured by one clock.
    one_clock: bool,
    /// When the frames so far were shown.
    shown: Vec<Duration>,
}

impl Composer {
    /// Comes after the frames `before`.
    pub(super) fn new(
        scene: &Arc<Scene>,
        path: &CameraPath,
        one_clock: bool,
        before: &[FrameRecord],
    ) -> Self {
        let shown = before.iter().map(|record| record.shown).collect();
        Self { scene: Arc::clone(scene), path: path.clone(), one_clock, shown }
    }

    /// The next frame, in the order shown.
    pub(super) fn frame(&mut self, record: &FrameRecord) -> Frame {
        let previous = self.shown.last().copied();
        let frames_between = self.shown.iter().rev().take_while(|shown| **shown > record.published).count();
        self.shown.push(record.shown);
        let frame = frame(&self.scene, &self.path, record, previous, frames_between);
        let objects = count_objects(&self.scene, record.ids.iter().copied());
        Frame { objects_drawn: Some(objects), timeline: timeline(record, self.one_clock), ..frame }
    }
}

fn frame(
    scene: &Scene,
    path: &CameraPath,
    record: &FrameRecord,
    previous: Option<Duration>,
    frames_between: usize,
) -> Frame {
    let number = record.camera.frame();
    let pose = path.pose_of(&record.camera);
    let triangles = record
        .ids
        .iter()
        .filter_map(|id| scene.drawables().get(id.index()))
        .map(|drawable| u64::from(drawable.triangles))
        .sum();
    let stats = record.stats.as_ref();
    let bytes = record.traffic + stats.map(|s| s.to_other).unwrap_or_default();
    Frame {
        frame: number.0,
        eye: pose.map(|p| p.eye().to_array()).unwrap_or_default(),
        forward: pose.map(|p| p.forward().to_array()).unwrap_or_default(),
        up: pose.map(|p| p.up().to_array()).unwrap_or_default(),
        view_state: record.camera.view().0,
        or_ms: stats.map(|s| s.or_busy_ns as f64 * 1e-6),
        hc_ms: stats.map(|s| s.hc_end_ns.saturating_sub(s.hc_start_ns) as f64 * 1e-6),
        rvg_ms: Some(milliseconds(record.shown.saturating_sub(record.drawing))),
        frame_ms: previous.map(|previous| milliseconds(record.shown.saturating_sub(previous))),
        latency_frames: u32::try_from(frames_between).ok(),
        latency_ms: Some(milliseconds(record.shown.saturating_sub(record.published))),
        nodes_drawn: Some(record.ids.len() as u64),
        triangles_drawn: Some(triangles),
        occluders_drawn: stats.map(|s| u64::from(s.occluders)),
        occluder_triangles: stats.map(|s| s.occluder_triangles),
        culling: stats.map(|s| culling(&s.culling)),
        rounds: stats.map(|s| rounds(&s.rounds)),
        conservatively_visible: conservatively_visible(record),
        culled_by: Some(Machine::of(record.culler)),
        bytes: Some(bytes.total()),
        bytes_by_kind: Some(bytes),
        ..Frame::default()
    }
}

/// When each role was busy. Unless they are one, the culler's clock is laid over the display's where the
/// frame's begin was sent and arrived.
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

/// OR waits for ids before and between its work; the work ends where OR ends, so it is shown there as one
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

/// What was drawn because it was not known to be hidden, by reason.
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

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
