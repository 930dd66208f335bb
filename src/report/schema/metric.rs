//! The figures that a frame may have, as a table: what is summarised, drawn and printed.

use super::{CullingCounts, Frame, Machine};

/// A figure that every frame may have.
#[derive(Debug, Clone, Copy)]
pub struct Metric {
    /// Its key in [`Summary::metrics`](super::Summary::metrics).
    pub key: &'static str,
    /// Its unit; empty for counts and ratios.
    pub unit: &'static str,
    /// Its name, for tables.
    pub title: &'static str,
    /// Its value on a frame; `None` if it was not measured there.
    pub of: fn(&Frame) -> Option<f64>,
}

/// Every figure that is summarised, in the order of tables. PSNR is not among them: it is worst where it is
/// lowest, and has [`Summary::psnr_db`](super::Summary::psnr_db).
pub const METRICS: &[Metric] = &[
    metric("or_ms", "ms", "OR busy", |f| f.or_ms),
    metric("hc_ms", "ms", "HC busy", |f| f.hc_ms),
    metric("rvg_ms", "ms", "RVG busy", |f| f.rvg_ms),
    metric("occluders_device_ms", "ms", "occluders, on the device", |f| f.occluders_device_ms),
    metric("pyramid_device_ms", "ms", "depth pyramid, on the device", |f| f.pyramid_device_ms),
    metric("culling_device_ms", "ms", "culling, on the device", |f| f.culling_device_ms),
    metric("picture_device_ms", "ms", "picture, on the device", |f| f.picture_device_ms),
    metric("pair_ms", "ms", "OR and HC, one after the other", Frame::pair_ms),
    metric("frame_ms", "ms", "frame time as measured", |f| f.frame_ms),
    metric("latency_ms", "ms", "camera to picture", |f| f.latency_ms),
    metric("latency_frames", "frames", "camera to picture", |f| f.latency_frames.map(f64::from)),
    metric("nodes_drawn", "", "nodes drawn", |f| count(f.nodes_drawn)),
    metric("nodes_exact", "", "nodes exactly visible, same cut", |f| count(f.nodes_exact)),
    metric("node_tightness", "", "nodes drawn / exactly visible", |f| ratio(f.nodes_drawn, f.nodes_exact)),
    metric("objects_drawn", "", "objects drawn", |f| count(f.objects_drawn)),
    metric("objects_exact", "", "objects exactly visible, same cut", |f| count(f.objects_exact)),
    metric("object_tightness", "", "objects drawn / exactly visible", |f| {
        ratio(f.objects_drawn, f.objects_exact)
    }),
    metric("triangles_drawn", "", "triangles drawn", |f| count(f.triangles_drawn)),
    metric("triangles_exact", "", "triangles exactly visible, same cut", |f| count(f.triangles_exact)),
    metric("triangle_tightness", "", "triangles drawn / exactly visible", |f| {
        ratio(f.triangles_drawn, f.triangles_exact)
    }),
    metric("objects_exact_full", "", "objects exactly visible, full detail", |f| count(f.objects_exact_full)),
    metric("triangles_exact_full", "", "triangles exactly visible, full detail", |f| {
        count(f.triangles_exact_full)
    }),
    metric("occluders_drawn", "", "occluders drawn", |f| count(f.occluders_drawn)),
    metric("occluder_triangles", "", "occluder triangles", |f| count(f.occluder_triangles)),
    metric("boxes_tested", "", "boxes tested", |f| f.culling.map(|c| c.boxes_tested as f64)),
    metric("further_rounds", "", "further rounds", |f| f.rounds.map(|r| r.further.into())),
    metric("hidden_in_further_rounds", "", "nodes hidden in further rounds", |f| {
        f.rounds.map(|r| r.nodes_hidden as f64)
    }),
    metric("false_culled_nodes", "", "nodes falsely culled", |f| count(f.false_culled_nodes)),
    metric("false_culled_pixels", "px", "pixels falsely culled", |f| count(f.false_culled_pixels)),
    metric("false_culled_blob_px", "px", "largest falsely culled blob", |f| count(f.false_culled_blob_px)),
    metric("cut_mismatch_pixels", "px", "pixels unlike the unculled cut", |f| count(f.cut_mismatch_pixels)),
    metric("loading_pixels", "px", "pixels not exact yet", |f| count(f.loading_pixels)),
    metric("mismatching_pixels", "px", "pixels unlike full detail", |f| {
        f.full_detail.map(|e| e.mismatching_pixels as f64)
    }),
    metric("flip_mean", "", "FLIP against full detail, mean", |f| f.full_detail?.flip_mean),
    metric("flip_p99", "", "FLIP against full detail, 99th percentile", |f| f.full_detail?.flip_p99),
    metric("silhouette_max_px", "px", "silhouette deviation, largest", |f| f.full_detail?.silhouette_max_px),
    metric("silhouette_p95_px", "px", "silhouette deviation, 95th percentile", |f| {
        f.full_detail?.silhouette_p95_px
    }),
    metric("surface_max_px", "px", "surface deviation, largest", |f| f.full_detail?.surface_max_px),
    metric("surface_p95_px", "px", "surface deviation, 95th percentile", |f| f.full_detail?.surface_p95_px),
    metric("bytes", "B", "bytes sent", |f| count(f.bytes)),
];

const fn metric(
    key: &'static str,
    unit: &'static str,
    title: &'static str,
    of: fn(&Frame) -> Option<f64>,
) -> Metric {
    Metric { key, unit, title, of }
}

fn count(value: Option<u64>) -> Option<f64> {
    value.map(|v| v as f64)
}

/// `None` where there is nothing to be tight about.
fn ratio(drawn: Option<u64>, exact: Option<u64>) -> Option<f64> {
    let exact = exact.filter(|&e| e > 0)?;
    Some(drawn? as f64 / exact as f64)
}

impl Frame {
    /// The cullers' work for the frame, milliseconds: OR and then HC. `None` unless both were measured.
    #[must_use]
    pub fn pair_ms(&self) -> Option<f64> {
        Some(self.or_ms? + self.hc_ms?)
    }

    /// Whether the display culled it itself, and not by occlusion: each method of that looks at a node or
    /// tests something.
    #[must_use]
    pub fn is_not_culled(&self) -> bool {
        let found_nothing = |counts: CullingCounts| counts.nodes_visited + counts.boxes_tested == 0;
        self.culled_by == Some(Machine::Display) && self.culling.is_some_and(found_nothing)
    }
}
