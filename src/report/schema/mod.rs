//! `report.json`: what a run leaves behind, as types. `docs/report.md` documents every key.
//!
//! Three rules hold throughout:
//! - A figure that was not measured is `null`, never 0: an audit may look at every tenth frame only.
//! - Units are in the key (`_ms`, `_px`, `_deg`, `_db`); lengths without one are metres, counts have none.
//! - The top level and the frames hold what a path file holds (`width`, `height`, `vfov_deg`, `near`, and per
//!   frame `eye`, `forward`, `up`), so that any report can be walked again.

mod ended;
mod frame;
mod loading;
mod metric;
mod model;
mod run;
mod stat;
mod summary;
mod sweep;

pub use ended::{Ended, HowEnded};
pub use frame::{
    CullingCounts, FalseCull, FalseCullCause, Frame, FramePictures, ImageDifference, Role, RoundCounts,
    SentBytes, Span, VisibleObject,
};
pub use loading::Loading;
pub use metric::{METRICS, Metric};
pub use model::Model;
pub use run::{Machine, MemoryUse, Mode, RoleInfo, Run, SceneInfo, SentAhead, ViewStateInfo, timestamp};
use serde::{Deserialize, Serialize};
pub use stat::{LowStat, Stat};
pub use summary::{
    Bandwidth, DeviationVerdict, PAPER_OBJECT_TIGHTNESS, PAPER_TRIANGLE_TIGHTNESS, Summary, Tightness,
};
pub use sweep::SweepPoint;

/// The version of the schema that this program writes. Keys may be added without a new version; a key that
/// changes its meaning or goes away brings one.
pub const SCHEMA_VERSION: u32 = 6;

/// The same of `compare.json`.
pub const COMPARISON_VERSION: u32 = 2;

/// A whole report: `report.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// [`SCHEMA_VERSION`] of the program that wrote it.
    pub schema_version: u32,
    /// The run: its scene, machines and settings.
    pub run: Run,
    /// Width of every picture, pixels.
    pub width: u32,
    /// Height of every picture, pixels.
    pub height: u32,
    /// Vertical field of view, degrees.
    pub vfov_deg: f64,
    /// Distance of the near plane, metres.
    pub near: f64,
    /// The frames' figures, condensed.
    pub summary: Summary,
    /// Speed against error over epsilon; empty unless the run was a sweep.
    #[serde(default)]
    pub sweep: Vec<SweepPoint>,
    /// One record a frame, in the order shown.
    pub frames: Vec<Frame>,
}

/// The picture that all frames of a run share: the top-level keys that a path file has as well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Vertical field of view, degrees.
    pub vfov_deg: f64,
    /// Distance of the near plane, metres.
    pub near: f64,
}

impl Report {
    /// A report of `frames`, summarised. `wall_ms` is the time from the first picture shown to the last, if
    /// it was measured.
    #[must_use]
    pub fn new(
        run: Run,
        projection: Projection,
        frames: Vec<Frame>,
        wall_ms: Option<f64>,
        ended: Ended,
    ) -> Self {
        let summary = Summary::of(&run, &frames, wall_ms, ended);
        let Projection { width, height, vfov_deg, near } = projection;
        Self {
            schema_version: SCHEMA_VERSION,
            run,
            width,
            height,
            vfov_deg,
            near,
            summary,
            sweep: Vec::new(),
            frames,
        }
    }

    /// The same report with the points of a sweep over epsilon.
    #[must_use]
    pub fn with_sweep(self, sweep: Vec<SweepPoint>) -> Self {
        Self { sweep, ..self }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::Value;

    use super::*;
    use crate::report::sample::{self, keys};

    #[test]
    fn the_documentation_names_every_key_and_cause() {
        let docs = include_str!("../../../docs/report.md");
        let mut found = BTreeSet::new();
        keys(&serde_json::to_value(sample::report()).unwrap(), &mut found);
        found.extend(METRICS.iter().map(|m| m.key.to_owned()));
        let causes = FalseCullCause::ALL.map(|c| serde_json::to_value(c).unwrap());
        found.extend(causes.iter().filter_map(Value::as_str).map(str::to_owned));
        assert!(found.len() > 120, "{}", found.len());
        let missing: Vec<_> = found.iter().filter(|key| !docs.contains(&format!("`{key}`"))).collect();
        assert!(missing.is_empty(), "docs/report.md does not name {missing:?}");
        assert!(docs.contains(&format!("| `schema_version` | {SCHEMA_VERSION} |")));
    }

    #[test]
    fn the_sample_leaves_no_key_unfilled() {
        let report = sample::report();
        // Frame 0 has no frame before it, pictures are entered when they are written, and no audited frame is
        // exact and still loading.
        let mut frame = serde_json::to_value(&report.frames[27]).unwrap();
        frame["loading_pixels"] = report.frames[39].loading_pixels.into();
        frame.as_object_mut().unwrap().remove("pictures");
        let value = serde_json::json!([frame, report.run, report.summary, report.sweep]);
        fn nulls(path: &str, value: &Value, found: &mut Vec<String>) {
            match value {
                Value::Null => found.push(path.to_owned()),
                Value::Object(map) => map.iter().for_each(|(k, v)| nulls(&format!("{path}.{k}"), v, found)),
                Value::Array(list) => list.iter().for_each(|v| nulls(path, v, found)),
                _ => {}
            }
        }
        let mut found = Vec::new();
        nulls("", &value, &mut found);
        assert!(found.is_empty(), "{found:?}");
    }

    #[test]
    fn every_frame_has_the_promised_keys_and_null_where_nothing_was_measured() {
        let frame = serde_json::to_value(Frame::default()).unwrap();
        for key in [
            "false_culled_nodes",
            "false_culled_pixels",
            "nodes_drawn",
            "nodes_exact",
            "triangles_drawn",
            "triangles_exact",
            "cut_mismatch_pixels",
            "or_ms",
            "hc_ms",
            "rvg_ms",
            "occluders_device_ms",
            "pyramid_device_ms",
            "culling_device_ms",
            "picture_device_ms",
            "bytes",
        ] {
            assert_eq!(frame.get(key), Some(&Value::Null), "{key}");
        }
        assert_eq!(frame["frame"], 0);
    }

    #[test]
    fn a_report_survives_json_bit_for_bit() {
        let report = sample::report();
        let text = serde_json::to_string(&report).unwrap();
        assert_eq!(serde_json::from_str::<Report>(&text).unwrap(), report);
    }

    #[test]
    fn a_report_is_a_path() {
        let report = serde_json::to_value(sample::report()).unwrap();
        for key in ["width", "height", "vfov_deg", "near"] {
            assert!(report[key].is_number(), "{key}");
        }
        for key in ["eye", "forward", "up"] {
            assert_eq!(report["frames"][5][key].as_array().map(Vec::len), Some(3), "{key}");
        }
    }
}
