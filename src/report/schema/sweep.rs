//! Speed against error and number of cullers: one point a run.

use serde::{Deserialize, Serialize};

use super::Report;

/// One run of a sweep: what it cost and how wrong its pictures were. Times and counts are medians over the
/// run's frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepPoint {
    /// The bound on the level-of-detail error, pixels.
    pub epsilon_px: f64,
    /// How many cullers the walk had.
    #[serde(default)]
    pub cullers: u32,
    /// Which visible set cullers drew their occluders from.
    #[serde(default)]
    pub schedule: String,
    /// Frames a second as measured.
    pub measured_fps: Option<f64>,
    /// Frames a second that a machine for each role would show: a model, of runs whose roles computed one
    /// after another.
    pub modelled_fps: Option<f64>,
    /// From handing a camera out to its picture, median, milliseconds: modelled where the rate is.
    #[serde(default)]
    pub latency_ms: Option<f64>,
    /// OR busy, median, milliseconds.
    pub or_ms: Option<f64>,
    /// HC busy, median, milliseconds.
    pub hc_ms: Option<f64>,
    /// RVG busy, median, milliseconds.
    pub rvg_ms: Option<f64>,
    /// Nodes drawn, median.
    pub nodes_drawn: Option<f64>,
    /// Triangles drawn, median.
    pub triangles_drawn: Option<f64>,
    /// Objects drawn over objects exactly visible at the same LOD cut, median.
    #[serde(default)]
    pub object_tightness: Option<f64>,
    /// Triangles drawn over triangles exactly visible at the same LOD cut, median.
    #[serde(default)]
    pub triangle_tightness: Option<f64>,
    /// Bytes sent a frame, median.
    pub bytes: Option<f64>,
    /// Frames audited.
    pub audited_frames: u32,
    /// Pixels falsely culled, all audited frames.
    pub false_culled_pixels: Option<u64>,
    /// Pixels unlike the unculled LOD cut, all audited frames.
    pub cut_mismatch_pixels: Option<u64>,
    /// PSNR against full detail, median, decibels; `null` if the pictures were equal or not compared.
    pub psnr_db: Option<f64>,
    /// FLIP against full detail: median over the frames of each map's mean.
    pub flip_mean: Option<f64>,
    /// Largest silhouette deviation of all frames, pixels.
    pub silhouette_max_px: Option<f64>,
}

impl SweepPoint {
    /// Frames a second as modelled, if the roles computed one after another: what was measured then is no
    /// walk's speed. Else as measured.
    #[must_use]
    pub fn fps(&self) -> Option<f64> {
        self.modelled_fps.or(self.measured_fps)
    }

    /// The row of a sweep for `report`'s run.
    #[must_use]
    pub fn of(report: &Report) -> Self {
        let summary = &report.summary;
        let median = |key: &str| summary.metrics.get(key).map(|s| s.median);
        Self {
            epsilon_px: report.run.epsilon_px,
            cullers: report.run.cullers,
            schedule: report.run.schedule.clone(),
            measured_fps: summary.measured_fps,
            modelled_fps: summary.model.map(|model| model.fps),
            latency_ms: summary.model.map(|model| model.latency_ms).or_else(|| median("latency_ms")),
            or_ms: median("or_ms"),
            hc_ms: median("hc_ms"),
            rvg_ms: median("rvg_ms"),
            nodes_drawn: median("nodes_drawn"),
            triangles_drawn: median("triangles_drawn"),
            object_tightness: summary.tightness.objects,
            triangle_tightness: summary.tightness.triangles,
            bytes: median("bytes"),
            audited_frames: summary.audited_frames,
            false_culled_pixels: summary.false_culled_pixels_total,
            cut_mismatch_pixels: summary.cut_mismatch_pixels_total,
            psnr_db: summary.psnr_db.and_then(|s| s.median),
            flip_mean: median("flip_mean"),
            silhouette_max_px: summary.metrics.get("silhouette_max_px").map(|s| s.max),
        }
    }
}
