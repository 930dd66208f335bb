//! The work of each frame: how many ids, and how long the roles compute.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_proto::{BatchSize, Camera, DrawableId, FrameNumber};

use crate::report::Report;
use crate::trace::{Trace, TraceError, looks_like_a_trace};

/// The work of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Load {
    /// How many ids HC finds visible: the paper's `n`.
    pub nodes: u32,
    /// How long OR draws the frame's occluders.
    pub or: Duration,
    /// How long HC culls.
    pub hc: Duration,
    /// How long RVG draws the picture.
    pub rvg: Duration,
}

/// The work of the frames, repeated.
#[derive(Debug, Clone, PartialEq)]
pub struct Workload {
    source: Source,
    times: Times,
}

/// How long roles compute, if different from the recording, as on other machines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Times {
    /// OR.
    pub or: Option<Duration>,
    /// HC; ids are found at the same fractions of it.
    pub hc: Option<Duration>,
    /// RVG.
    pub rvg: Option<Duration>,
}

/// Never empty.
#[derive(Debug, Clone, PartialEq)]
enum Source {
    /// Counts and times; the ids and their times are made up, evenly.
    Loads(Arc<[Load]>),
    /// A recorded walk.
    Trace(Arc<Trace>),
}

/// Why a recorded walk cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WorkloadError {
    /// The file cannot be read.
    #[error("cannot read {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// It begins like a trace, but is not a valid one.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The file is neither a trace nor a report.
    #[error("{} is neither a trace of `trimaran run --record` nor a report.json", .path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// The error, and its position.
        #[source]
        cause: serde_json::Error,
    },
    /// No frame of the report has its work recorded.
    #[error("no frame of {} has all of `nodes_drawn`, `or_ms`, `hc_ms` and `rvg_ms`: record a trace with `trimaran run --record`", .path.display())]
    Nothing {
        /// The file.
        path: PathBuf,
    },
}

impl Workload {
    /// The same work for every frame.
    #[must_use]
    pub fn steady(load: Load) -> Self {
        Self::of_source(Source::Loads(Arc::new([load])))
    }

    /// The work of a walk that was recorded just now.
    #[must_use]
    pub fn of_trace(trace: Trace) -> Self {
        Self::of_source(Source::Trace(Arc::new(trace)))
    }

    fn of_source(source: Source) -> Self {
        Self { source, times: Times::default() }
    }

    /// The same with these times.
    #[must_use]
    pub fn taking(self, times: Times) -> Self {
        Self { times, ..self }
    }

    /// The work of a recorded walk: a trace of `trimaran run --record`, or the counts and times of a
    /// `report.json`. Frames without them are left out.
    ///
    /// # Errors
    /// When the file cannot be read, is neither, or has no such counts and times.
    pub fn recorded(path: &Path) -> Result<Self, WorkloadError> {
        let read = |cause| WorkloadError::Read { path: path.to_owned(), cause };
        let mut head = Vec::new();
        File::open(path).and_then(|file| file.take(64).read_to_end(&mut head)).map_err(read)?;
        if looks_like_a_trace(&head) {
            return Ok(Self::of_trace(Trace::read(path)?));
        }
        let file = File::open(path).map_err(read)?;
        let report: Report = serde_json::from_reader(BufReader::new(file))
            .map_err(|cause| WorkloadError::Parse { path: path.to_owned(), cause })?;
        let time = |ms: Option<f64>| Duration::try_from_secs_f64(ms? / 1e3).ok();
        let loads: Arc<[Load]> = report
            .frames
            .iter()
            // If a frame lacked some drawables, the drawn ones are not those that were sent for it.
            .filter(|frame| frame.lacking == 0)
            .filter_map(|frame| {
                let nodes = u32::try_from(frame.nodes_drawn?).ok()?;
                Some(Load { nodes, or: time(frame.or_ms)?, hc: time(frame.hc_ms)?, rvg: time(frame.rvg_ms)? })
            })
            .collect();
        if loads.is_empty() {
            return Err(WorkloadError::Nothing { path: path.to_owned() });
        }
        Ok(Self::of_source(Source::Loads(loads)))
    }

    /// The recorded walk, if it has ids and cameras.
    #[must_use]
    pub fn trace(&self) -> Option<&Trace> {
        match &self.source {
            Source::Loads(_) => None,
            Source::Trace(trace) => Some(trace),
        }
    }

    /// How many frames it has before it begins again.
    #[must_use]
    pub fn frames(&self) -> usize {
        match &self.source {
            Source::Loads(loads) => loads.len(),
            Source::Trace(trace) => trace.frames().len(),
        }
    }

    /// The work of that frame.
    #[must_use]
    pub fn of(&self, frame: u32) -> Load {
        let Load { nodes, or, hc, rvg } = self.recorded_load(frame);
        let Times { or: other_or, hc: other_hc, rvg: other_rvg } = self.times;
        Load { nodes, or: other_or.unwrap_or(or), hc: other_hc.unwrap_or(hc), rvg: other_rvg.unwrap_or(rvg) }
    }

    fn recorded_load(&self, frame: u32) -> Load {
        let load = match &self.source {
            Source::Loads(loads) => loads.get(frame as usize % loads.len().max(1)).copied(),
            Source::Trace(trace) => trace.frame(frame).map(|frame| {
                let nodes = u32::try_from(frame.ids.len()).unwrap_or(u32::MAX);
                Load { nodes, or: frame.or, hc: frame.hc, rvg: frame.rvg }
            }),
        };
        load.unwrap_or(Load { nodes: 0, or: Duration::ZERO, hc: Duration::ZERO, rvg: Duration::ZERO })
    }

    /// The ids of that frame, ascending.
    #[must_use]
    pub fn ids(&self, frame: u32) -> Cow<'_, [DrawableId]> {
        match &self.source {
            Source::Loads(_) => {
                (0..self.of(frame).nodes).map(|node| DrawableId(node.wrapping_mul(7))).collect()
            }
            Source::Trace(trace) => {
                trace.frame(frame).map_or_else(Cow::default, |frame| Cow::Borrowed(&frame.ids[..]))
            }
        }
    }

    /// Pairs of an id count and the time after which HC of that frame has found as many, ascending. Those of
    /// a recorded walk are as recorded; others are even, `batch` after `batch`.
    #[must_use]
    pub fn finds(&self, frame: u32, batch: BatchSize) -> Vec<(usize, Duration)> {
        let Load { nodes, hc, .. } = self.of(frame);
        match &self.source {
            Source::Loads(_) => {
                let nodes = nodes as usize;
                let ends = (1..=nodes.div_ceil(batch.items())).map(|end| (end * batch.items()).min(nodes));
                ends.map(|count| (count, hc.mul_f64(count as f64 / nodes as f64))).collect()
            }
            Source::Trace(trace) => trace.frame(frame).map_or_else(Vec::new, |frame| {
                let scale = hc.as_secs_f64() / frame.hc.as_secs_f64().max(1e-9);
                let there = |at: Duration| if hc == frame.hc { at } else { at.mul_f64(scale) };
                frame.finds().map(|(count, at)| (count, there(at))).collect()
            }),
        }
    }

    /// How many drawables the scene has at least: one more than the largest id.
    #[must_use]
    pub fn drawables(&self) -> u32 {
        let largest = |frame: usize| self.ids(frame as u32).iter().map(|id| id.0).max();
        (0..self.frames()).filter_map(largest).max().map_or(0, |id| id.saturating_add(1))
    }

    /// The camera of that frame.
    #[must_use]
    pub fn camera(&self, frame: FrameNumber) -> Camera {
        let recorded = self.trace().and_then(|trace| trace.frame(frame.0));
        recorded.map_or_else(|| Camera::at_origin(frame), |recorded| recorded.camera.for_frame(frame))
    }

    /// The mean number of ids of the first `frames` frames.
    #[must_use]
    pub fn mean_nodes(&self, frames: u32) -> f64 {
        let sum: u64 = (0..frames).map(|frame| u64::from(self.of(frame).nodes)).sum();
        sum as f64 / f64::from(frames.max(1))
    }
}
