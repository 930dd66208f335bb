//! Roles in virtual time: they pause as long as a workload says that they compute, and note the times of
//! events.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use trimaran_actors::{Cameras, CullerId, CullerWork, DisplayWork, RoleError, VisibleIds};
use trimaran_cull::Image;
use trimaran_proto::{BatchSize, Camera, DrawableId, FrameNumber, FrameStats, SentBytes};
use trimaran_transport::{Instant, Net, StatsHandle, sleep_until};

use super::outcome::FrameTimes;
use super::workload::Workload;

/// State shared by all roles of a session.
#[derive(Debug, Clone)]
pub(super) struct Recording {
    workload: Arc<Workload>,
    drawables: u32,
    /// Whether frames may arrive with gaps.
    gaps: bool,
    log: Arc<Mutex<Log>>,
}

/// The records of the roles.
#[derive(Debug, Default)]
pub(super) struct Log {
    /// By frame.
    pub(super) times: Vec<FrameTimes>,
    /// The received ids of each frame that came with gaps.
    pub(super) remains: BTreeMap<u32, Vec<DrawableId>>,
    /// The counters of both ends of every link to the display.
    pub(super) stats: Vec<StatsHandle>,
    /// The bytes that cullers report having sent to each other.
    pub(super) to_others: SentBytes,
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
        Self { workload: Arc::new(workload.clone()), drawables: workload.drawables(), gaps, log }
    }

    /// The log, to be written or read.
    pub(super) fn log<T>(&self, act: impl FnOnce(&mut Log) -> T) -> T {
        act(&mut self.log.lock())
    }

    /// Notes the culler of a frame.
    pub(super) fn culled_by(&self, frame: FrameNumber, culler: Option<CullerId>) {
        self.note(frame, |times| times.culler = culler);
    }

    /// How many drawables the scene has.
    pub(super) fn drawables(&self) -> u32 {
        self.drawables
    }

    fn note(&self, frame: FrameNumber, act: impl FnOnce(&mut FrameTimes)) {
        self.log(|log| log.times.get_mut(frame.0 as usize).map(act));
    }
}

/// A culler's work.
#[derive(Debug)]
pub(super) struct RecordedCulling {
    recording: Recording,
    clock: Arc<dyn Net>,
    batch: BatchSize,
    /// When it began to wait for a camera.
    asked: Instant,
    /// The frame it works on.
    frame: FrameNumber,
    /// Whether its occluders come bit by bit.
    as_they_come: bool,
    /// When the occluders received so far are drawn.
    drawn: Instant,
}

impl RecordedCulling {
    pub(super) fn new(recording: &Recording, clock: &Arc<dyn Net>, batch: BatchSize) -> Self {
        let start = Instant::from_nanos(0);
        let (recording, clock) = (recording.clone(), Arc::clone(clock));
        Self {
            recording,
            clock,
            batch,
            asked: start,
            frame: FrameNumber(0),
            as_they_come: false,
            drawn: start,
        }
    }
}

impl CullerWork for RecordedCulling {
    fn awaits_camera(&mut self) {
        self.asked = self.clock.now();
    }

    fn has_camera(&mut self, camera: &Camera) {
        let (asked, taken) = (self.asked, self.clock.now());
        self.recording.note(camera.frame(), |times| (times.asked, times.taken) = (asked, taken));
    }

    async fn begin_occluders(&mut self, camera: Camera, as_they_come: bool) -> Result<(), RoleError> {
        let (frame, fed) = (camera.frame(), self.clock.now());
        let or = if as_they_come { Duration::ZERO } else { self.recording.workload.of(frame.0).or };
        (self.frame, self.as_they_come, self.drawn) = (frame, as_they_come, fed.after(or));
        self.recording.note(frame, |times| {
            // A display that culls itself takes the camera when it is published.
            (times.taken, times.fed) = (times.taken.max(times.published), fed);
        });
        Ok(())
    }

    /// If they come bit by bit, each id takes its share of OR.
    fn take_occluders(&mut self, ids: &[DrawableId]) -> Result<(), RoleError> {
        if !self.as_they_come {
            return Ok(());
        }
        let Recording { workload, .. } = &self.recording;
        let all = self.frame.0.checked_sub(1).map_or(0, |before| workload.of(before).nodes);
        let share = ids.len() as f64 / f64::from(all.max(1));
        let or = workload.of(self.frame.0).or;
        self.drawn = self.drawn.max(self.clock.now()).after(or.mul_f64(share.min(1.0)));
        Ok(())
    }

    async fn complete_occluders(&mut self, camera: Camera) -> Result<(), RoleError> {
        sleep_until(&*self.clock, self.drawn).await;
        let occluded = self.clock.now();
        self.recording.note(camera.frame(), |times| times.occluded = occluded);
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

    fn frame_stats(&mut self) -> FrameStats {
        FrameStats { frame: self.frame, ..FrameStats::default() }
    }
}

/// A display's work and its cameras.
#[derive(Debug, Clone)]
pub(super) struct RecordedPictures {
    pub(super) recording: Recording,
    pub(super) clock: Arc<dyn Net>,
}

impl DisplayWork for RecordedPictures {
    async fn draw(
        &mut self,
        camera: Camera,
        ids: &mut Vec<DrawableId>,
        missing: u32,
    ) -> Result<usize, RoleError> {
        let (frame, arrived) = (camera.frame(), self.clock.now());
        if missing > 0 {
            if !self.recording.gaps {
                return Err(RoleError::device("drawing a picture")(IncompleteFrame { frame }));
            }
            self.recording.note(frame, |times| times.missing = missing);
            self.recording.log(|log| log.remains.insert(frame.0, ids.clone()));
        }
        compute(&self.clock, arrived, self.recording.workload.of(frame.0).rvg).await;
        let shown = self.clock.now();
        self.recording.note(frame, |times| (times.arrived, times.shown) = (arrived, shown));
        Ok(0)
    }

    fn picture(&mut self) -> Result<Option<&Image>, RoleError> {
        Ok(None)
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
