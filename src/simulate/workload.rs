//! What each frame takes: how many ids, and how long the roles compute.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::time::Duration;

use thiserror::Error;

use crate::report::Report;

/// What one frame takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Load {
    /// How many ids HC finds visible: the paper's `n`.
    pub nodes: u32,
    /// How long OR draws the frame's occluders.
    pub or: Duration,
    /// How long HC culls; the ids come evenly over that time.
    pub hc: Duration,
    /// How long RVG draws the picture.
    pub rvg: Duration,
}

/// What the frames take, over and over; never empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Workload(Vec<Load>);

/// Why a recorded walk cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WorkloadError {
    /// The file cannot be read.
    #[error("cannot read {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// The file is no report.
    #[error("{} is no report.json", .path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        #[source]
        cause: serde_json::Error,
    },
    /// No frame of the report says what it took.
    #[error("no frame of {} has all of `nodes_drawn`, `or_ms`, `hc_ms` and `rvg_ms`: record it with `trimaran run`", .path.display())]
    Nothing {
        /// The file.
        path: PathBuf,
    },
}

impl Workload {
    /// Every frame takes the same.
    #[must_use]
    pub fn steady(load: Load) -> Self {
        Self(vec![load])
    }

    /// What the frames of a report took. Frames that do not say are left out.
    ///
    /// # Errors
    /// When the file cannot be read, is no report, or says nothing of this.
    pub fn recorded(path: &Path) -> Result<Self, WorkloadError> {
        let file = File::open(path).map_err(|cause| WorkloadError::Read { path: path.to_owned(), cause })?;
        let report: Report = serde_json::from_reader(BufReader::new(file))
            .map_err(|cause| WorkloadError::Parse { path: path.to_owned(), cause })?;
        let time = |ms: Option<f64>| Duration::try_from_secs_f64(ms? / 1e3).ok();
        let loads: Vec<Load> = report
            .frames
            .iter()
            .filter_map(|frame| {
                let nodes = u32::try_from(frame.nodes_drawn?).ok()?;
                Some(Load { nodes, or: time(frame.or_ms)?, hc: time(frame.hc_ms)?, rvg: time(frame.rvg_ms)? })
            })
            .collect();
        if loads.is_empty() {
            return Err(WorkloadError::Nothing { path: path.to_owned() });
        }
        Ok(Self(loads))
    }

    /// What that frame takes.
    #[must_use]
    pub fn of(&self, frame: u32) -> Load {
        let Self(loads) = self;
        let nothing = Load { nodes: 0, or: Duration::ZERO, hc: Duration::ZERO, rvg: Duration::ZERO };
        loads.get(frame as usize % loads.len().max(1)).copied().unwrap_or(nothing)
    }

    /// The mean number of ids of the first `frames` frames.
    #[must_use]
    pub fn mean_nodes(&self, frames: u32) -> f64 {
        let sum: u64 = (0..frames).map(|frame| u64::from(self.of(frame).nodes)).sum();
        sum as f64 / f64::from(frames.max(1))
    }
}
