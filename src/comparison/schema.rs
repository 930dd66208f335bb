//! `compare.json`: systems held against each other on one scene, the same paths and one machine.
//!
//! Times of roles taken alone, with the model made of them, and what was measured as processes stand in keys
//! of their own (`alone` and `measured`). Each path's figure is kept: a ratio is one of the same path.

use serde::{Deserialize, Serialize};

use super::{Coherence, System};
pub use crate::report::schema::COMPARISON_VERSION;
use crate::report::schema::{Frame, Report, SceneInfo};

/// Systems held against each other.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// [`COMPARISON_VERSION`] of the program that wrote it.
    pub schema_version: u32,
    /// The program's version.
    pub version: String,
    /// The command line, one argument an entry, the program first.
    pub command_line: Vec<String>,
    /// When it began: RFC 3339, UTC.
    pub started: String,
    /// The scene.
    pub scene: SceneInfo,
    /// The device that drew, for all roles.
    pub device: String,
    /// Its driver.
    pub driver: String,
    /// Cores that all roles shared.
    pub cores: u32,
    /// Width of every picture, pixels.
    pub width: u32,
    /// Height of every picture, pixels.
    pub height: u32,
    /// Where the cameras came from: `auto`, or the path file.
    pub path: String,
    /// The seed of the first `auto` path. Each further one has the next seed.
    pub seed: Option<u64>,
    /// How many paths were walked. One from a file is walked as often.
    pub paths: u32,
    /// Frames of each walk.
    pub frames: u32,
    /// How processes were joined.
    pub link: String,
    /// A table for each error bound.
    pub tables: Vec<ComparisonTable>,
    /// Speed against error.
    pub curve: Vec<CurvePoint>,
    /// How much pictures change because levels do: the same for every system.
    pub popping: Vec<Popping>,
    /// Speed against coherence.
    pub coherence: Vec<CoherencePoint>,
    /// Speed against the age of the camera, walked by the clock.
    pub lag: Vec<LagPoint>,
    /// Remarks that belong beside every figure.
    pub notes: Vec<String>,
}

/// All systems at one error bound.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ComparisonTable {
    /// The bound on the picture's level-of-detail error, pixels.
    pub epsilon_px: f64,
    /// The exactly visible set, on the frames that were audited.
    pub exact: Vec<ExactFrame>,
    /// The systems.
    pub systems: Vec<SystemFigures>,
}

/// The exactly visible part of a frame's LOD cut.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ExactFrame {
    /// The path, counted from 0.
    pub path: u32,
    /// The frame.
    pub frame: u32,
    /// Nodes that own a pixel.
    pub nodes: u64,
    /// Objects that own a pixel.
    pub objects: u64,
    /// Triangles that own a pixel.
    pub triangles: Option<u64>,
}

/// A system at one error bound.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SystemFigures {
    /// Which one.
    pub system: System,
    /// Its roles one after another, and the model made of their times.
    pub alone: AloneFigures,
    /// The walk as processes of this machine.
    pub measured: MeasuredFigures,
    /// The sets that it drew, and their errors: one record a path.
    pub drawn: Vec<DrawnFigures>,
    /// Its frames on the first path.
    pub frames: Vec<SystemFrame>,
}

/// Times of roles that computed one after another, one figure a path. No busy time holds another role's work.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct AloneFigures {
    /// OR busy, median over the frames, milliseconds.
    pub or_ms: Vec<f64>,
    /// HC busy, likewise.
    pub hc_ms: Vec<f64>,
    /// RVG busy, likewise.
    pub rvg_ms: Vec<f64>,
    /// Frames a second that a machine for each role would show: a model.
    pub model_fps: Vec<f64>,
    /// The same if all time that is in no role's busy time came on top.
    pub model_fps_at_least: Vec<f64>,
    /// From handing a camera out to its picture as modelled, median, milliseconds.
    pub model_latency_ms: Vec<f64>,
}

/// Walks as processes that share this machine's cores.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MeasuredFigures {
    /// How many processes: 1 where the roles are threads that share memory.
    pub processes: u8,
    /// Frames a second; one figure a path.
    pub fps: Vec<f64>,
    /// From handing a camera out to its picture, median, milliseconds; one figure a path.
    pub latency_ms: Vec<f64>,
}

/// A system's drawings on the frames that were audited: all but the first, before which nothing is known, or
/// each n-th. Without an audit, on all frames.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DrawnFigures {
    /// Nodes drawn a frame, mean.
    pub nodes: f64,
    /// Objects drawn a frame, mean.
    pub objects: f64,
    /// Triangles drawn a frame, mean.
    pub triangles: f64,
    /// Bytes that were sent a frame as processes, mean.
    pub bytes: f64,
    /// Objects drawn over objects exactly visible, both summed over the audited frames: the paper's way.
    pub objects_over_exact: Option<f64>,
    /// Triangles drawn over triangles exactly visible, likewise.
    pub triangles_over_exact: Option<f64>,
    /// The same of single frames: their median.
    pub objects_over_exact_median: Option<f64>,
    /// Likewise of triangles.
    pub triangles_over_exact_median: Option<f64>,
    /// Frames that were held against their LOD cut without culling.
    pub audited_frames: u32,
    /// Pixels unlike it, all of them.
    pub wrong_pixels: u64,
    /// Of these, the pixels that culling has right: the f64 rasterizer hides there what the driver shows.
    #[serde(default)]
    pub right_pixels: u64,
    /// Exactly visible nodes that were not drawn, all frames.
    pub lost_nodes: u64,
}

/// A frame of a system, its roles one after another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SystemFrame {
    /// The frame.
    pub frame: u32,
    /// Time from the picture before to this one with a machine for each role: the model's, milliseconds.
    pub modelled_ms: Option<f64>,
    /// Objects drawn.
    pub objects: u64,
    /// Triangles drawn.
    pub triangles: u64,
}

/// A system at an error bound on one path: what it costs, and how wrong its pictures are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Which system.
    pub system: System,
    /// The bound, pixels.
    pub epsilon_px: f64,
    /// The path, counted from 0.
    pub path: u32,
    /// Its cost.
    pub cost: FrameCost,
    /// Mean FLIP against full detail, median over the audited frames.
    pub flip_mean: Option<f64>,
    /// Largest deviation of a silhouette from full detail, all audited frames, pixels.
    pub silhouette_max_px: Option<f64>,
    /// Largest deviation of a surface, likewise.
    pub surface_max_px: Option<f64>,
    /// Pixels unlike the LOD cut without culling, all audited frames.
    pub wrong_pixels: u64,
}

/// How much pictures of a path change because levels do. Each audited frame is drawn without culling, with
/// its own levels and with those that the frame before it would have: nothing but the level differs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Popping {
    /// The error bound, pixels.
    pub epsilon_px: f64,
    /// The path, counted from 0.
    pub path: u32,
    /// Frames that were looked at.
    pub frames: u32,
    /// The share of a picture's pixels that change, median.
    pub changed: f64,
    /// The same, 95th percentile.
    pub changed_p95: f64,
    /// Mean FLIP between the two pictures, median.
    pub flip_mean: f64,
    /// The share of frames in which a level changes whose error is more than a pixel on the screen.
    pub frames_over_1_px: f64,
}

/// The cost of a system's frames, its roles one after another; medians over the frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameCost {
    /// Between two pictures with a machine for each role, mean: the model's, milliseconds.
    pub modelled_ms: Option<f64>,
    /// OR busy, milliseconds.
    pub or_ms: Option<f64>,
    /// HC busy, milliseconds.
    pub hc_ms: Option<f64>,
    /// RVG busy, milliseconds.
    pub rvg_ms: Option<f64>,
    /// Nodes drawn.
    pub nodes: Option<f64>,
    /// Triangles drawn.
    pub triangles: Option<f64>,
}

/// A system on a path whose frames have more or less in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CoherencePoint {
    /// Which system.
    pub system: System,
    /// How much frames have in common.
    pub coherence: Coherence,
    /// The error bound, pixels.
    pub epsilon_px: f64,
    /// Between two frames the eye moves so far, median, metres.
    pub step_m: f64,
    /// And turns so far, median, degrees.
    pub turn_deg: f64,
    /// Its cost.
    pub cost: FrameCost,
    /// Nodes drawn over nodes exactly visible, median; known where `exact` walked as well.
    pub nodes_over_exact: Option<f64>,
}

/// A system that walks by the clock, as processes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LagPoint {
    /// Which system.
    pub system: System,
    /// Poses of the path a second.
    pub poses_per_second: f64,
    /// The error bound, pixels.
    pub epsilon_px: f64,
    /// Frames a second.
    pub fps: Option<f64>,
    /// Age of a picture's camera when it is shown, median, milliseconds.
    pub lag_ms: Option<f64>,
    /// How many poses the path has gone on since, median.
    pub lag_poses: Option<f64>,
    /// Triangles drawn, median.
    pub triangles: Option<f64>,
    /// Mean FLIP of the pictures shown against those of the poses due when they were shown, median.
    pub flip_mean: Option<f64>,
}

impl ComparisonTable {
    /// How many paths all its systems have walked.
    #[must_use]
    pub fn paths(&self) -> u32 {
        let paths = self.systems.iter().map(|figures| figures.drawn.len()).min();
        paths.and_then(|paths| u32::try_from(paths).ok()).unwrap_or(0)
    }
}

impl SystemFigures {
    /// Pixels unlike the picture without culling, all paths.
    #[must_use]
    pub fn wrong_pixels(&self) -> u64 {
        self.drawn.iter().map(|drawn| drawn.wrong_pixels).sum()
    }

    /// Of these, the pixels that culling has right, all paths.
    #[must_use]
    pub fn right_pixels(&self) -> u64 {
        self.drawn.iter().map(|drawn| drawn.right_pixels).sum()
    }

    /// Exactly visible nodes that were not drawn, all paths.
    #[must_use]
    pub fn lost_nodes(&self) -> u64 {
        self.drawn.iter().map(|drawn| drawn.lost_nodes).sum()
    }

    /// Audited frames, all paths.
    #[must_use]
    pub fn audited_frames(&self) -> u32 {
        self.drawn.iter().map(|drawn| drawn.audited_frames).sum()
    }
}

impl FrameCost {
    /// Of a walk whose roles computed one after another.
    #[must_use]
    pub fn of(report: &Report) -> Self {
        let median = |key: &str| report.summary.metrics.get(key).map(|stat| stat.median);
        Self {
            modelled_ms: report.summary.model.map(|model| 1000.0 / model.fps),
            or_ms: median("or_ms"),
            hc_ms: median("hc_ms"),
            rvg_ms: median("rvg_ms"),
            nodes: median("nodes_drawn"),
            triangles: median("triangles_drawn"),
        }
    }
}

impl DrawnFigures {
    /// Of a walk; the bytes are another one's, whose roles were processes.
    #[must_use]
    pub fn of(report: &Report) -> Self {
        let audited: Vec<&Frame> =
            report.frames.iter().filter(|frame| frame.objects_exact.is_some()).collect();
        let frames = if audited.is_empty() { report.frames.iter().collect() } else { audited };
        let mean = |of: fn(&Frame) -> Option<u64>| {
            frames.iter().filter_map(|frame| of(frame)).sum::<u64>() as f64 / frames.len().max(1) as f64
        };
        let over = |drawn: fn(&Frame) -> Option<u64>, exact: fn(&Frame) -> Option<u64>| {
            let pairs = frames.iter().filter_map(|frame| Some((drawn(frame)?, exact(frame)?)));
            let (drawn, exact) = pairs.fold((0, 0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1));
            (exact > 0).then(|| drawn as f64 / exact as f64)
        };
        let summary = &report.summary;
        let of_the_driver = summary.false_culls.iter().filter(|cull| cull.cause.is_of_the_driver());
        Self {
            nodes: mean(|frame| frame.nodes_drawn),
            objects: mean(|frame| frame.objects_drawn),
            triangles: mean(|frame| frame.triangles_drawn),
            bytes: 0.0,
            objects_over_exact: over(|frame| frame.objects_drawn, |frame| frame.objects_exact),
            triangles_over_exact: over(|frame| frame.triangles_drawn, |frame| frame.triangles_exact),
            objects_over_exact_median: summary.tightness.objects,
            triangles_over_exact_median: summary.tightness.triangles,
            audited_frames: summary.audited_frames,
            wrong_pixels: summary.cut_mismatch_pixels_total.unwrap_or(0),
            right_pixels: of_the_driver.map(|cull| cull.pixels).sum(),
            lost_nodes: summary.false_culled_nodes_total.unwrap_or(0),
        }
    }
}

/// The paper's figures (tables 1 to 3) for a model and its error bound.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperModel {
    /// The model.
    pub name: &'static str,
    /// The error bound, pixels.
    pub epsilon_px: f64,
    /// Its systems.
    pub systems: [PaperSystem; 3],
    /// Triangles exactly visible a frame.
    pub triangles_exact: f64,
    /// Objects exactly visible a frame.
    pub objects_exact: f64,
}

/// The paper's figures for a system.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperSystem {
    /// Which one.
    pub system: System,
    /// Frames a second.
    pub fps: f64,
    /// Triangles drawn a frame; the paper has one figure for both forms of GigaWalk.
    pub triangles: f64,
    /// Objects drawn a frame, likewise.
    pub objects: f64,
}

/// The paper's models: three PCs with a 2.2 GHz Pentium 4 and a GeForce4 Ti 4600 each, 1024x1024.
pub const PAPER: [PaperModel; 2] = [
    PaperModel {
        name: "Power Plant, 13 million triangles, 1,200 objects",
        epsilon_px: 10.0,
        systems: paper([10.0, 6.2, 5.6], [91_550.0, 119_240.0], [1557.0, 2727.0]),
        triangles_exact: 7_500.0,
        objects_exact: 850.0,
    },
    PaperModel {
        name: "Double Eagle tanker, 82 million triangles, 127,000 objects",
        epsilon_px: 20.0,
        systems: paper([11.5, 4.85, 3.5], [141_630.0, 173_350.0], [3313.0, 4036.0]),
        triangles_exact: 10_890.0,
        objects_exact: 1833.0,
    },
];

/// Of the paper's own system, Distributed GigaWalk and GigaWalk, in the order of the paper's table 1.
const fn paper(fps: [f64; 3], triangles: [f64; 2], objects: [f64; 2]) -> [PaperSystem; 3] {
    let (own, giga) = (System::Paper, System::GigaWalk);
    let distributed = System::DistributedGigaWalk;
    [
        PaperSystem { system: own, fps: fps[0], triangles: triangles[0], objects: objects[0] },
        PaperSystem { system: distributed, fps: fps[1], triangles: triangles[1], objects: objects[1] },
        PaperSystem { system: giga, fps: fps[2], triangles: triangles[1], objects: objects[1] },
    ]
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::{comparison::sample, report::sample::keys};

    #[test]
    fn the_documentation_names_every_key_of_a_comparison() {
        let docs = include_str!("../../docs/report.md");
        let mut found = BTreeSet::new();
        keys(&serde_json::to_value(sample::comparison()).unwrap(), &mut found);
        assert!(found.len() > 60, "{}", found.len());
        let named = |key: &str| docs.contains(&format!("`{key}`")) || docs.contains(&format!(".{key}`"));
        let missing: Vec<_> = found.iter().filter(|key| !named(key)).collect();
        assert!(missing.is_empty(), "docs/report.md does not name {missing:?}");
        assert!(docs.contains(&format!("| `schema_version` | {COMPARISON_VERSION} |")));
    }
}
