//! `report.json`: what a run leaves behind, as types. `docs/report.md` documents every key.
//!
//! Three rules hold throughout:
//! - A figure that was not measured is `null`, never 0: an audit may look at every tenth frame only.
//! - Units are in the key (`_ms`, `_px`, `_deg`, `_db`); lengths without one are metres, counts have none.
//! - The top level and the frames hold what a path file holds (`width`, `height`, `vfov_deg`, `near`, and per frame `eye`,
//!   `forward`, `up`), so that any report can be walked again.

mod frame;
mod run;
mod summary;
mod sweep;

pub use frame::{
    BytesByKind, CullingCounts, FalseCull, FalseCullCause, Frame, FramePictures, PassTime, PictureError,
    RegionDeviation, Role, Span, VisibleObject,
};
pub use run::{Mode, RoleInfo, Run, SceneInfo, Seat, timestamp};
use serde::{Deserialize, Serialize};
pub use summary::{
    Bandwidth, LowStat, METRICS, Metric, ModelledFps, PAPER_OBJECT_TIGHTNESS, PAPER_TRIANGLE_TIGHTNESS,
    SilhouetteVerdict, Stat, Summary, Tightness,
};
pub use sweep::SweepPoint;

/// The version of the schema that this program writes. Keys may be added without a new version; a key that changes its meaning
/// or goes away brings one.
pub const SCHEMA_VERSION: u32 = 1;

/// A whole report: `report.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// [`SCHEMA_VERSION`] of the program that wrote it.
    pub schema_version: u32,
    /// What was run, where, and with which settings.
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
pub struct Lens {
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
    /// A report of `frames`, summarised. `wall_ms` is the time from the first picture shown to the last, if it was measured.
    #[must_use]
    pub fn new(run: Run, lens: Lens, frames: Vec<Frame>, wall_ms: Option<f64>) -> Self {
        let summary = Summary::of(&run, &frames, wall_ms);
        let Lens { width, height, vfov_deg, near } = lens;
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
