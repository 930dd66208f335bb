//! Frames: how many each stage has done, and how long it took.

use std::{sync::atomic::AtomicU64, time::Duration};

use prometheus_client::{
    encoding::EncodeLabelSet,
    metrics::{counter::Counter, family::Family, gauge::Gauge, histogram::Histogram},
    registry::{Registry, Unit},
};
use trimaran_actors::{SessionObserver, ShownFrame};
use trimaran_proto::FrameStats;

use super::LatencyReading;

/// Upper bounds of the buckets of times, seconds. Common frame rates have one each: 90, 60, 30 and 20.
const BOUNDS: [f64; 14] =
    [0.0005, 0.001, 0.002, 0.004, 0.008, 1.0 / 90.0, 1.0 / 60.0, 0.025, 1.0 / 30.0, 0.05, 0.1, 0.2, 0.5, 1.0];

/// The frames of a process's roles. Clones share them.
#[derive(Debug, Clone)]
pub struct FrameMetrics {
    frames: Family<Stage, Counter>,
    seconds: Family<Stage, Histogram, fn() -> Histogram>,
    camera_to_picture: Histogram,
    /// The sum of these times, which a histogram does not tell, seconds.
    camera_to_picture_sum: Counter<f64, AtomicU64>,
    late: Counter,
    queued: Gauge,
}

/// A stage of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Stage {
    stage: &'static str,
}

/// Drawing occluders.
const OR: Stage = Stage { stage: "or" };
/// Culling.
const HC: Stage = Stage { stage: "hc" };
/// Another session has culled the same view.
const SHARED: Stage = Stage { stage: "shared" };
/// Drawing the picture.
const RVG: Stage = Stage { stage: "rvg" };

fn times() -> Histogram {
    Histogram::new(BOUNDS)
}

impl Default for FrameMetrics {
    fn default() -> Self {
        Self {
            frames: Family::default(),
            seconds: Family::new_with_constructor(times),
            camera_to_picture: times(),
            camera_to_picture_sum: Counter::default(),
            late: Counter::default(),
            queued: Gauge::default(),
        }
    }
}

impl FrameMetrics {
    pub(super) fn register(&self, registry: &mut Registry) {
        let Self { frames, seconds, camera_to_picture, late, queued, .. } = self;
        let help = "Frames by stage: or (occluders drawn), hc (culled), shared (culled by another session), rvg (shown)";
        registry.register("frames", help, frames.clone());
        registry.register_with_unit("frame", "Time of a frame by stage", Unit::Seconds, seconds.clone());
        let help = "Time from a frame's camera to its picture";
        registry.register_with_unit("camera_to_picture", help, Unit::Seconds, camera_to_picture.clone());
        registry.register("frames_late", "How often a culler was late with its frames", late.clone());
        registry.register("queue_frames", "Culled frames that wait to be drawn", queued.clone());
    }

    /// A display has shown a frame.
    pub fn shown(&self, frame: &ShownFrame<'_>) {
        self.queued.set(frame.queued.into());
        if !frame.again {
            self.count(RVG, frame.shown.saturating_sub(frame.drawing));
            let latency = frame.shown.saturating_sub(frame.published).as_secs_f64();
            self.camera_to_picture.observe(latency);
            self.camera_to_picture_sum.inc_by(latency);
        }
    }

    /// A culler is late.
    pub fn late(&self) {
        self.late.inc();
    }

    fn count(&self, stage: Stage, took: Duration) {
        self.frames.get_or_create(&stage).inc();
        self.seconds.get_or_create(&stage).observe(took.as_secs_f64());
    }

    /// How many frames were culled, taken from another session, and shown.
    pub(super) fn counts(&self) -> [u64; 3] {
        [HC, SHARED, RVG].map(|stage| self.frames.get_or_create(&stage).get())
    }

    pub(super) fn latency(&self) -> LatencyReading {
        let [.., frames] = self.counts();
        LatencyReading { frames, seconds: self.camera_to_picture_sum.get() }
    }

    pub(super) fn times_late(&self) -> u64 {
        self.late.get()
    }
}

impl SessionObserver for FrameMetrics {
    fn culled(&self, stats: &FrameStats) {
        self.count(OR, Duration::from_nanos(stats.or_busy_ns));
        self.count(HC, Duration::from_nanos(stats.hc_end_ns.saturating_sub(stats.hc_start_ns)));
    }

    fn shared(&self) {
        self.frames.get_or_create(&SHARED).inc();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::Metrics;

    #[test]
    fn a_culled_frame_is_counted_in_each_stage_with_its_time() {
        let metrics = Metrics::new("culler");
        let stats = FrameStats {
            or_busy_ns: 3_000_000,
            hc_start_ns: 10_000_000,
            hc_end_ns: 40_000_000,
            ..FrameStats::default()
        };
        metrics.frames().culled(&stats);
        metrics.frames().shared();
        let text = metrics.text().unwrap();
        for line in [
            "trimaran_frames_total{stage=\"or\"} 1",
            "trimaran_frames_total{stage=\"hc\"} 1",
            "trimaran_frames_total{stage=\"shared\"} 1",
            "trimaran_frame_seconds_sum{stage=\"or\"} 0.003",
            "trimaran_frame_seconds_bucket{le=\"0.002\",stage=\"or\"} 0",
            "trimaran_frame_seconds_bucket{le=\"0.004\",stage=\"or\"} 1",
            "trimaran_frame_seconds_bucket{le=\"0.025\",stage=\"hc\"} 0",
            "trimaran_frame_seconds_count{stage=\"hc\"} 1",
        ] {
            assert!(text.lines().any(|found| found == line), "no {line} in {text}");
        }
        assert_eq!(metrics.frames().counts(), [1, 1, 0]);
    }
}
