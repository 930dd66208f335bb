//! Many walks on one page: a row a walk, and medians over the walks of a kind.

mod comparison;
mod page;
mod read;

use std::path::PathBuf;

use serde::Serialize;

pub use self::comparison::{ComparedSystem, OverPaths};
use self::read::{Read, Report, read};
use super::{
    UNCHECKED,
    format::{figure, grouped, plural},
    interval::Interval,
    schema::{Ended, Machine, Mode},
    text::table,
};
use crate::culling::CullingMethod;

/// The version of what [`ManyWalks`] is as JSON: as for a report, keys may be added without a new one.
pub const MANY_WALKS_VERSION: u32 = 1;

/// The walks of several folders.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ManyWalks {
    /// [`MANY_WALKS_VERSION`].
    pub schema_version: u32,
    /// The version of the program that read them.
    pub version: String,
    /// Over all walks.
    pub all: WalkFigures,
    /// Over the walks of each kind, in the order of `walks`.
    pub kinds: Vec<KindFigures>,
    /// The walks, by scene, device, settings and folder.
    pub walks: Vec<WalkRow>,
    /// The systems of comparisons, in the same order.
    pub comparisons: Vec<ComparedSystem>,
    /// The folders in which there is no report that can be read, as they were given.
    pub without_report: Vec<WithoutReport>,
}

/// A walk.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WalkRow {
    /// Its folder, as it was given.
    pub folder: String,
    /// Its kind.
    #[serde(flatten)]
    pub kind: WalkKind,
    /// The camera path: `auto`, or a file.
    pub path: String,
    /// The seed of an automatic path.
    pub seed: Option<u64>,
    /// When it began: RFC 3339, UTC.
    pub started: String,
    /// How many frames it has.
    pub frames: u32,
    /// Frames a second: modelled, if the roles computed one after another, else as measured.
    pub fps: Option<f64>,
    /// The median time from a camera to its picture, milliseconds: modelled where the rate is.
    pub latency_median_ms: Option<f64>,
    /// Its 95th percentile, milliseconds; `null` where the rate is modelled.
    pub latency_p95_ms: Option<f64>,
    /// How many frames were audited.
    pub audited_frames: u32,
    /// Pixels unlike the unculled LOD cut, over the audited frames; `null` if there are none.
    pub wrong_pixels: Option<u64>,
    /// Visible nodes that culling lost, likewise.
    pub lost_nodes: Option<u64>,
    /// How it ended.
    pub ended: Ended,
    /// Whether its report lacks pictures and checks, which `trimaran report FOLDER` adds.
    pub lacks_checks: bool,
    #[serde(skip)]
    path_of_folder: PathBuf,
}

/// The properties that walks share if their figures can be compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WalkKind {
    /// The name of the scene's file, without its folder.
    pub scene: String,
    /// The scene's fingerprint.
    pub scene_hash: String,
    /// The display's device.
    pub device: String,
    /// Width of the pictures, pixels.
    pub width: u32,
    /// Height of the pictures, pixels.
    pub height: u32,
    /// The bound on the level-of-detail error, pixels.
    pub epsilon_px: f64,
    /// The occlusion test.
    pub occlusion_test: String,
    /// How what is visible was found.
    pub culling: CullingMethod,
    /// The number of cullers requested.
    pub cullers: u32,
    /// Whose last visible set a culler draws as occluders.
    pub schedule: String,
    /// How the roles are joined.
    pub link: String,
    /// Whether every camera became a frame.
    pub mode: Mode,
    /// Whether the roles computed one after another.
    pub alone: bool,
}

/// The figures of the walks of a kind.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KindFigures {
    /// The kind.
    #[serde(flatten)]
    pub kind: WalkKind,
    /// The figures.
    #[serde(flatten)]
    pub figures: WalkFigures,
}

/// The figures of several walks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WalkFigures {
    /// How many walks have a report.
    pub walks: u64,
    /// How many of them were walked to the end, and have a report that lacks nothing.
    pub whole: u64,
    /// Frames of all walks.
    pub frames: u64,
    /// Audited frames of all walks.
    pub audited_frames: u64,
    /// Pixels unlike the unculled LOD cut, over all audited frames; `null` if there are none.
    pub wrong_pixels: Option<u64>,
    /// Visible nodes that culling lost, likewise.
    pub lost_nodes: Option<u64>,
    /// Frames a second, over the walks that finished.
    pub fps: Option<OverWalks>,
    /// The walks' median latencies, likewise, milliseconds.
    pub latency_median_ms: Option<OverWalks>,
    /// The 95th percentiles of the walks' latencies, likewise, milliseconds.
    pub latency_p95_ms: Option<OverWalks>,
}

/// The median over walks of one figure a walk, by nearest rank, with its 95 % interval (percentile bootstrap).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OverWalks {
    /// How many walks have the figure.
    pub walks: u64,
    /// The median.
    pub median: f64,
    /// The interval's lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// A folder without a report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct WithoutReport {
    /// The folder, as it was given.
    pub folder: String,
    /// Why, in words.
    pub why: String,
}

/// The most folders that a message names.
const NAMED: usize = 5;

impl ManyWalks {
    /// Reads the reports in these folders; each folder counts once. A sweep stands for its walks.
    #[must_use]
    pub fn read(folders: &[PathBuf]) -> Self {
        let (mut walks, mut comparisons, mut without_report) = (Vec::new(), Vec::new(), Vec::new());
        for (folder, found) in read(folders) {
            match found {
                Ok(Report::Walk(walk)) => walks.push(WalkRow::of(folder, *walk)),
                Ok(Report::Comparison(comparison)) => comparisons.extend(comparison.systems(&folder)),
                Err(why) => without_report
                    .push(WithoutReport { folder: folder.display().to_string(), why: why.to_string() }),
            }
        }
        walks.sort_by_cached_key(WalkRow::order);
        // The systems of a folder stay in the order of its tables.
        let order = |of: &ComparedSystem| [&of.scene, &of.device, &of.folder].map(|text| natural(text));
        comparisons.sort_by_cached_key(order);
        let figures = |walks: &[WalkRow]| {
            let kind = walks.first()?.kind.clone();
            Some(KindFigures { kind, figures: WalkFigures::of(walks) })
        };
        let kinds = walks.chunk_by(|a, b| a.kind == b.kind).filter_map(figures).collect();
        Self {
            schema_version: MANY_WALKS_VERSION,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            all: WalkFigures::of(&walks),
            kinds,
            walks,
            comparisons,
            without_report,
        }
    }

    /// The missing parts, in one sentence without a full stop: walks that ended early or lack checks, comparisons
    /// that ended early, and folders without a report. `None` if nothing is.
    #[must_use]
    pub fn gaps(&self) -> Option<String> {
        let incomplete = self.walks.iter().filter(|walk| !walk.is_whole()).map(|walk| &walk.folder);
        let mut early: Vec<_> =
            self.comparisons.iter().filter(|of| of.ended_early).map(|of| &of.folder).collect();
        early.dedup();
        let missing = self.without_report.iter().map(|folder| &folder.folder);
        let count = |count: usize, one: &str, many: &str| {
            (count > 0).then(|| plural(count as u64, one, many)).into_iter()
        };
        let counts: Vec<_> = count(incomplete.clone().count(), "walk is incomplete", "walks are incomplete")
            .chain(count(early.len(), "comparison is incomplete", "comparisons are incomplete"))
            .chain(count(missing.len(), "folder has no report", "folders have no report"))
            .collect();
        if counts.is_empty() {
            return None;
        }
        let all: Vec<_> = incomplete.chain(early).chain(missing).map(String::as_str).collect();
        let named = all.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
        let more = all.len().saturating_sub(NAMED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        Some(format!("{}: {named}{more}", counts.join(", ")))
    }

    /// The figures of each kind, and of compared systems, as tables for a terminal, ending in a line break.
    #[must_use]
    pub fn text(&self) -> String {
        let kinds: Vec<Vec<String>> = self.kinds.iter().map(|of| of.cells("-")).collect();
        let systems: Vec<Vec<String>> = self.comparisons.iter().map(|of| of.cells("-")).collect();
        let tables = [(&KindFigures::HEAD[..], kinds), (&ComparedSystem::HEAD[..], systems)];
        let tables = tables.iter().filter(|(_, rows)| !rows.is_empty()).map(|(head, rows)| table(head, rows));
        let tables = tables.collect::<Vec<_>>().join("\n");
        if tables.is_empty() { "no walks\n".to_owned() } else { tables }
    }
}

impl WalkRow {
    fn of(folder: PathBuf, Read { run, width, height, summary, .. }: Read) -> Self {
        let device = run.roles.iter().find(|role| role.machine == Machine::Display).or(run.roles.first());
        let latency = summary.metrics.get("latency_ms");
        let model = summary.model;
        Self {
            folder: folder.display().to_string(),
            kind: WalkKind {
                scene: super::html::walk::file_name(&run.scene.file).to_owned(),
                scene_hash: run.scene.hash,
                device: device.map(|role| role.device.clone()).unwrap_or_default(),
                width,
                height,
                epsilon_px: run.epsilon_px,
                occlusion_test: run.occlusion_test,
                culling: run.culling,
                cullers: run.cullers,
                schedule: run.schedule,
                link: run.link,
                mode: run.mode,
                alone: run.alone,
            },
            path: run.path,
            seed: run.seed,
            started: run.started,
            frames: summary.frames,
            fps: if run.alone { model.map(|model| model.fps) } else { summary.measured_fps },
            latency_median_ms: match run.alone {
                true => model.map(|model| model.latency_ms),
                false => latency.map(|latency| latency.median),
            },
            latency_p95_ms: latency.filter(|_| !run.alone).map(|latency| latency.p95),
            audited_frames: summary.audited_frames,
            wrong_pixels: summary.cut_mismatch_pixels_total,
            lost_nodes: summary.false_culled_nodes_total,
            ended: summary.ended,
            lacks_checks: folder.join(UNCHECKED).exists(),
            path_of_folder: folder,
        }
    }

    /// Whether it was walked to the end, and its report lacks nothing.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        !self.ended.early() && !self.lacks_checks
    }

    /// How it ended, in words.
    fn ending(&self) -> String {
        match self.ended.sentence(self.frames) {
            Some(early) => early,
            None if self.lacks_checks => "finished; checks are missing".to_owned(),
            None => "finished".to_owned(),
        }
    }

    /// Its place among others.
    fn order(&self) -> [Vec<(String, u64)>; 5] {
        let WalkKind { scene, scene_hash, device, .. } = &self.kind;
        let texts = [scene, scene_hash, device, &self.kind.words(), &self.folder];
        texts.map(|text| natural(text))
    }
}

impl WalkKind {
    /// Its settings, in words.
    fn words(&self) -> String {
        let Self { width, height, epsilon_px, occlusion_test, culling, cullers, schedule, link, .. } = self;
        let mut words = format!("{width} × {height} pixels, ε {} px, {occlusion_test}", figure(*epsilon_px));
        match cullers {
            0 => words += ", no culler",
            count => {
                words += &format!(", {} over {link}", plural(u64::from(*count), "culler", "cullers"));
                if schedule != "independent" {
                    words += &format!(", {schedule}");
                }
            }
        }
        if *culling != CullingMethod::default() {
            words += &format!(", {culling}");
        }
        if self.mode == Mode::Live {
            words += ", live";
        }
        if self.alone {
            words += ", modelled";
        }
        words
    }
}

impl KindFigures {
    /// The columns of its tables.
    const HEAD: [&'static str; 8] =
        ["scene", "device", "settings", "walks", "frames/s", "latency ms", "latency p95 ms", "wrong pixels"];

    /// Its row; `none` for figures not measured.
    fn cells(&self, none: &str) -> Vec<String> {
        let WalkFigures { walks, wrong_pixels, fps, latency_median_ms, latency_p95_ms, .. } = self.figures;
        let over = |figure: Option<OverWalks>| figure.map_or_else(|| none.to_owned(), |of| of.words());
        vec![
            self.kind.scene.clone(),
            self.kind.device.clone(),
            self.kind.words(),
            grouped(walks as f64),
            over(fps),
            over(latency_median_ms),
            over(latency_p95_ms),
            wrong(wrong_pixels),
        ]
    }
}

/// Wrong pixels, in a cell.
fn wrong(pixels: Option<u64>) -> String {
    pixels.map_or_else(|| "not audited".to_owned(), |pixels| grouped(pixels as f64))
}

impl ComparedSystem {
    /// The columns of its tables.
    const HEAD: [&'static str; 7] =
        ["scene", "device", "ε (px)", "system", "MODEL frames/s", "measured frames/s", "wrong pixels"];

    /// Its row; `none` for figures not measured.
    fn cells(&self, none: &str) -> Vec<String> {
        let over = |of: Option<OverPaths>| {
            of.map_or_else(|| none.to_owned(), |OverPaths { mean, low, high }| within([mean, low, high]))
        };
        vec![
            self.scene.clone(),
            self.device.clone(),
            figure(self.epsilon_px),
            self.system.clone(),
            over(self.model_fps),
            over(self.measured_fps),
            wrong(self.wrong_pixels),
        ]
    }
}

impl WalkFigures {
    fn of(walks: &[WalkRow]) -> Self {
        let count = |of: fn(&WalkRow) -> u32| walks.iter().map(|walk| u64::from(of(walk))).sum();
        // Without an audited frame nothing is known, which is not zero.
        let known = |of: fn(&WalkRow) -> Option<u64>| walks.iter().filter_map(of).reduce(|a, b| a + b);
        let over = |of: fn(&WalkRow) -> Option<f64>| {
            OverWalks::of(walks.iter().filter(|walk| !walk.ended.early()).filter_map(of))
        };
        Self {
            walks: walks.len() as u64,
            whole: walks.iter().filter(|walk| walk.is_whole()).count() as u64,
            frames: count(|walk| walk.frames),
            audited_frames: count(|walk| walk.audited_frames),
            wrong_pixels: known(|walk| walk.wrong_pixels),
            lost_nodes: known(|walk| walk.lost_nodes),
            fps: over(|walk| walk.fps),
            latency_median_ms: over(|walk| walk.latency_median_ms),
            latency_p95_ms: over(|walk| walk.latency_p95_ms),
        }
    }
}

impl OverWalks {
    fn of(figures: impl Iterator<Item = f64>) -> Option<Self> {
        let figures: Vec<f64> = figures.filter(|figure| figure.is_finite()).collect();
        let walks = figures.len() as u64;
        let Interval { value, low, high } = Interval::of_median(figures)?;
        Some(Self { walks, median: value, low, high })
    }

    fn words(self) -> String {
        within([self.median, self.low, self.high])
    }
}

/// A figure, and its interval where it has one.
fn within(figures: [f64; 3]) -> String {
    let [value, low, high] = figures.map(figure);
    if low == high { value } else { format!("{value} ({low} to {high})") }
}

/// A text by which `walk-2` comes before `walk-10`: words, and the numbers behind them.
fn natural(mut text: &str) -> Vec<(String, u64)> {
    let mut parts = Vec::new();
    while !text.is_empty() {
        let (word, rest) = text.split_at(text.find(|c: char| c.is_ascii_digit()).unwrap_or(text.len()));
        let (number, rest) = rest.split_at(rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len()));
        let number = if number.is_empty() { 0 } else { number.parse().unwrap_or(u64::MAX) };
        parts.push((word.to_owned(), number));
        text = rest;
    }
    parts
}

#[cfg(test)]
mod tests;
