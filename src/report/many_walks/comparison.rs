//! The comparisons among many walks: a row a system and error bound. Their tables are read without the
//! laboratory, which writes them.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::report::{interval::Interval, schema::SceneInfo};

/// A system in a comparison, at one error bound.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparedSystem {
    /// The comparison's folder, as it was given.
    pub folder: String,
    /// The name of the scene's file, without its folder.
    pub scene: String,
    /// The device that drew.
    pub device: String,
    /// The bound on the level-of-detail error, pixels.
    pub epsilon_px: f64,
    /// The system.
    pub system: String,
    /// Frames a second that a machine for each role would show: a model.
    pub model_fps: Option<OverPaths>,
    /// Frames a second as processes of one machine.
    pub measured_fps: Option<OverPaths>,
    /// How many frames were audited.
    pub audited_frames: u32,
    /// Pixels unlike the unculled LOD cut; `null` if no frame was audited.
    pub wrong_pixels: Option<u64>,
    /// Whether the comparison ended early.
    pub ended_early: bool,
    #[serde(skip)]
    pub(super) path_of_folder: PathBuf,
}

/// The mean over a comparison's paths, with its 95 % interval (percentile bootstrap).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OverPaths {
    /// The mean.
    pub mean: f64,
    /// The interval's lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// The part of `compare.json` that is read.
#[derive(Debug, Deserialize)]
pub(super) struct ReadComparison {
    scene: SceneInfo,
    device: String,
    tables: Vec<ReadTable>,
    notes: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct ReadTable {
    epsilon_px: f64,
    systems: Vec<ReadSystem>,
}

#[derive(Debug, Deserialize)]
struct ReadSystem {
    system: String,
    alone: ReadAlone,
    measured: ReadMeasured,
    drawn: Vec<ReadDrawn>,
}

#[derive(Debug, Deserialize)]
struct ReadAlone {
    model_fps: Vec<f64>,
}

#[derive(Debug, Deserialize)]
struct ReadMeasured {
    fps: Vec<f64>,
}

#[derive(Debug, Deserialize)]
struct ReadDrawn {
    audited_frames: u32,
    wrong_pixels: u64,
}

impl ReadComparison {
    /// Its systems, in the order of its tables.
    pub(super) fn systems(self, folder: &Path) -> Vec<ComparedSystem> {
        let Self { scene, device, tables, notes, .. } = self;
        let scene = crate::report::html::walk::file_name(&scene.file).to_owned();
        // Its notes are all that tells.
        let ended_early = notes.iter().any(|note| note.starts_with("ended early"));
        let row = |epsilon_px: f64, read: ReadSystem| {
            let audited_frames = read.drawn.iter().map(|drawn| drawn.audited_frames).sum();
            let wrong_pixels: u64 = read.drawn.iter().map(|drawn| drawn.wrong_pixels).sum();
            ComparedSystem {
                folder: folder.display().to_string(),
                scene: scene.clone(),
                device: device.clone(),
                epsilon_px,
                system: read.system,
                model_fps: OverPaths::of(read.alone.model_fps),
                measured_fps: OverPaths::of(read.measured.fps),
                audited_frames,
                wrong_pixels: (audited_frames > 0).then_some(wrong_pixels),
                ended_early,
                path_of_folder: folder.to_owned(),
            }
        };
        let all = tables.into_iter().flat_map(|ReadTable { epsilon_px, systems }| {
            systems.into_iter().map(move |system| (epsilon_px, system))
        });
        all.map(|(epsilon_px, system)| row(epsilon_px, system)).collect()
    }
}

impl OverPaths {
    fn of(figures: Vec<f64>) -> Option<Self> {
        let Interval { value, low, high } = Interval::of_mean(figures)?;
        Some(Self { mean: value, low, high })
    }
}
