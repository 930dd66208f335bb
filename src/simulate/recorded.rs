//! What roles do in virtual time: they pause for as long as a workload says that they compute, and note when
//! what happened.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_actors::{Cameras, CullerWork, DisplayWork, Drawn, IdError, RoleError, VisibleIds};
use trimaran_proto::{BatchSize, Camera, DrawableId, FrameNumber, FrameStats, IdBatch, SentBytes};
use trimaran_transport::{FrameOutcome, Instant, Net, StatsHandle, sleep_until};

use super::outcome::FrameTimes;
use super::workload::Workload;

/// What all roles of a session have in common.
#[derive(Debug, Clone)]
pub(super) struct Recording {
    workload: Arc<Workload>,
    /// Whether frames may arrive with gaps.
    gaps: bool,
    log: Arc<Mutex<Log>>,
}

/// What the roles note.
#[derive(Debug, Default)]
pub(super) struct Log {
    /// By frame.
    pub(super) times: Vec<FrameTimes>,
    /// What came of each frame that came with gaps.
    pub(super) remains: BTreeMap<u32, Vec<DrawableId>>,
    /// The counters of every end of every link.
    pub(super) stats: Vec<StatsHandle>,
}

/// Ids are missing where all were promised.
#[derive(Debug, Error)]
#[error("{frame} arrived incomplete")]
struct IncompleteFrame {
    frame: FrameNumber,
}

impl Recording {
    pub(super) fn new(workload: &Workload, frames: u32, gaps: bool) -> Self {
        let times = (0..frames)
            .map(|frame| FrameTimes { nodes: workload.of(frame).nodes, ..FrameTimes::default() })
            .collect();
        let log = Arc::new(Mutex::new(Log { times, ..Log::default() }));
        Self { workload: Arc::new(workload.clone()), gaps, log }
    }

    /// The log, to be written or read.
    pub(super) fn log<T>(&self, act: impl FnOnce(&mut Log) -> T) -> T {
        act(&mut self.log.lock())
    }

    fn note(&self, frame: FrameNumber, act: impl FnOnce(&mut FrameTimes)) {
        self.log(|log| log.times.get_mut(frame.0 as usize).map(act));
    }
}

/// A culler's work.
#[derive(Debug)]
pub(super) struct RecordedCulling {
    pub(super) recording: Recording,
    pub(super) clock: Arc<dyn Net>,
    pub(super) batch: BatchSize,
    /// When it began to wait for a camera.
    pub(super) asked: Instant,
    /// The frame it works on.
    pub(super) frame: FrameNumber,
}

impl CullerWork for RecordedCulling {
    fn awaits_camera(&mut self) {
        self.asked = self.clock.now();
    }

    fn has_camera(&mut self, camera: &Camera) {
        let (asked, taken) = (self.asked, self.clock.now());
        self.recording.note(camera.frame(), |times| (times.asked, times.taken) = (asked, taken));
    }

    fn begin_occluders(&mut self, camera: Camera) -> Result<(), RoleError> {
        self.frame = camera.frame();
        Ok(())
    }

    fn take_occluders(&mut self, _: &IdBatch) -> Result<(), RoleError> {
        Ok(())
    }

    async fn complete_occluders(&mut self, camera: Camera) -> Result<(), RoleError> {
        let (frame, fed) = (camera.frame(), self.clock.now());
        compute(&self.clock, fed, self.recording.workload.of(frame.0).or).await;
        let occluded = self.clock.now();
        self.recording.note(frame, |times| (times.fed, times.occluded) = (fed, occluded));
        Ok(())
    }

    async fn cull(&mut self, camera: Camera, visible: &mut VisibleIds<'_>) -> Result<(), RoleError> {
        let Recording { workload, .. } = &self.recording;
        let frame = camera.frame();
        let (ids, began) = (workload.ids(frame.0), self.clock.now());
        let mut done = 0;
        for (count, at) in workload.finds(frame.0, self.batch) {
            compute(&self.clock, began, at).await;
            visible.push(ids.get(done..count).unwrap_or_default()).await?;
            done = count;
        }
        compute(&self.clock, began, workload.of(frame.0).hc).await;
        self.recording.note(frame, |times| times.culled = self.clock.now());
        Ok(())
    }

    fn frame_stats(&mut self, _: SentBytes, _: Duration) -> FrameStats {
        FrameStats { frame: self.frame, ..FrameStats::default() }
    }
}

/// A display's work and its cameras.
#[derive(Debug, Clone)]
pub(super) struct RecordedPictures {
    pub(super) recording: Recording,
    pub(super) clock: Arc<dyn Net>,
    /// What came of the frame, where it may come with gaps.
    pub(super) came: Vec<DrawableId>,
}

impl DisplayWork for RecordedPictures {
    fn begin(&mut self) {
        self.came.clear();
    }

    fn take(&mut self, batch: &IdBatch) -> Result<(), IdError> {
        if self.recording.gaps {
            self.came.extend(batch.iter());
        }
        Ok(())
    }

    async fn draw(&mut self, camera: Camera, outcome: FrameOutcome) -> Result<(), RoleError> {
        let (frame, arrived) = (camera.frame(), self.clock.now());
        if let FrameOutcome::Incomplete { expected, received, .. } = outcome {
            if !self.recording.gaps {
                return Err(RoleError::device("drawing a picture")(IncompleteFrame { frame }));
            }
            self.recording.note(frame, |times| times.missing = expected.saturating_sub(received));
            let came = std::mem::take(&mut self.came);
            self.recording.log(|log| log.remains.insert(frame.0, came));
        }
        compute(&self.clock, arrived, self.recording.workload.of(frame.0).rvg).await;
        let shown = self.clock.now();
        self.recording.note(frame, |times| (times.arrived, times.shown) = (arrived, shown));
        Ok(())
    }

    fn drawn(&mut self, _: bool) -> Result<Drawn<'_>, RoleError> {
        Ok(Drawn::default())
    }
}

impl Cameras for RecordedPictures {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        self.recording.note(frame, |times| times.published = self.clock.now());
        self.recording.workload.camera(frame)
    }
}

/// Until `time` after it `began`.
async fn compute(clock: &Arc<dyn Net>, began: Instant, time: Duration) {
    sleep_until(&**clock, began.after(time)).await;
}
