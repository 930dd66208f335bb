//! A recorded walk: the work of the three roles for each frame, for simulations without its scene or a GPU.
//!
//! ```text
//! trimaran run X.scene --record walk.trace     Trace::of, Trace::write
//! trimaran sim --trace walk.trace              Trace::read
//! ```
//! `docs/report.md` describes the file for other programs.

mod file;

use std::time::Duration;

use thiserror::Error;
use trimaran_proto::{Camera, DrawableId, FrameNumber, SceneHash};

use crate::walkthrough::{FrameRecord, Plan};

pub use file::{TraceError, TraceFault, looks_like_a_trace};

/// A recorded walk; at least one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// The scene that was walked through.
    pub scene: SceneHash,
    /// The picture's width and height, pixels.
    pub size: [u32; 2],
    /// The bound of the level-of-detail error, pixels.
    pub epsilon_px: f64,
    /// Whether culling stopped at nodes visible at fewer pixels than that (paper, section 4.5.2).
    pub few_pixels: bool,
    /// How many ids travelled in a batch.
    pub batch: u32,
    frames: Vec<TraceFrame>,
}

/// The work of the roles for one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TraceFrame {
    /// Its camera.
    pub camera: Camera,
    /// How long OR worked, waiting not counted.
    pub or: Duration,
    /// How long HC culled, sending included.
    pub hc: Duration,
    /// How long RVG drew.
    pub rvg: Duration,
    /// The ids that HC found visible, ascending and each once: the order in which it sends.
    pub ids: Vec<DrawableId>,
    /// Pairs of an id count and the time from the frame's begin until as many were at the display: both
    /// ascending, one entry for ids that came at once.
    pub found: Vec<(u32, Duration)>,
}

/// Why a walk cannot become a trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RecordError {
    /// No frame of the walk has complete figures.
    #[error("the walk was over before a culler had said what a frame took: walk more frames")]
    Nothing,
    /// The drawn set is not the culled one.
    #[error(
        "{frame} lost ids on its way, so that nobody knows what was culled: record over a link without a deadline"
    )]
    Lost {
        /// The frame.
        frame: FrameNumber,
    },
    /// Coarser drawables were drawn in place of some found ones.
    #[error(
        "{frame} was shown before all that was culled for it had come: record with `--while-loading wait`"
    )]
    Loading {
        /// The frame.
        frame: FrameNumber,
    },
}

/// The walk was recorded in another scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error(
    "the walk was recorded in scene {recorded}, and this is scene {here}: give the scene that it was recorded in"
)]
pub struct OtherScene {
    /// The scene of the trace.
    pub recorded: SceneHash,
    /// The given scene.
    pub here: SceneHash,
}

impl Trace {
    /// Checks that it was recorded in that scene.
    ///
    /// # Errors
    /// When it was recorded in another one.
    pub fn check_scene(&self, here: SceneHash) -> Result<(), OtherScene> {
        let recorded = self.scene;
        if recorded == here { Ok(()) } else { Err(OtherScene { recorded, here }) }
    }

    /// The trace of a walk through `scene` by `plan`, up to the first frame without its culler's figures.
    ///
    /// # Errors
    /// When no frame is left, or one lost ids or was shown before all of it had come.
    pub fn of(scene: SceneHash, plan: &Plan, records: &[FrameRecord]) -> Result<Self, RecordError> {
        let mut frames = Vec::with_capacity(records.len());
        // A frame that is shown again needs no work of the cullers.
        for record in records.iter().filter(|record| !record.again) {
            let Some(stats) = &record.stats else { break };
            let frame = record.camera.frame();
            if record.for_loss > 0 {
                return Err(RecordError::Lost { frame });
            }
            if record.lacking > 0 {
                return Err(RecordError::Loading { frame });
            }
            let mut ids = record.ids.clone();
            ids.sort_unstable();
            let hc = Duration::from_nanos(stats.hc_end_ns.saturating_sub(stats.hc_start_ns));
            // Frames culled by the display itself have no arrivals.
            let found = match record.culler {
                Some(_) => record.arrivals.clone(),
                None => u32::try_from(ids.len()).map(|count| vec![(count, hc)]).unwrap_or_default(),
            };
            frames.push(TraceFrame {
                camera: record.camera,
                or: Duration::from_nanos(stats.or_busy_ns),
                hc,
                rvg: record.shown.saturating_sub(record.drawing),
                ids,
                found,
            });
        }
        if frames.is_empty() {
            return Err(RecordError::Nothing);
        }
        Ok(Self {
            scene,
            size: [plan.viewport.width(), plan.viewport.height()],
            epsilon_px: plan.lod.epsilon_px(),
            few_pixels: plan.lod.stops_at_few_pixels(),
            batch: u32::try_from(plan.batch.items()).unwrap_or(u32::MAX),
            frames,
        })
    }

    /// The work of each frame.
    #[must_use]
    pub fn frames(&self) -> &[TraceFrame] {
        &self.frames
    }

    /// Frame number `frame` of the walk, repeated for ever.
    #[must_use]
    pub fn frame(&self, frame: u32) -> Option<&TraceFrame> {
        self.frames.get(frame as usize % self.frames.len().max(1))
    }
}

impl TraceFrame {
    /// Pairs of an id count and the time after which HC has found as many; it decides a whole level of the
    /// tree at once. Times are at most HC's own, so the delay to the display does not count.
    pub fn finds(&self) -> impl Iterator<Item = (usize, Duration)> {
        self.found.iter().map(|&(count, at)| (count as usize, at.min(self.hc)))
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{FrameStats, LodRule, SentBytes, Settings, Viewport};

    use super::*;
    use crate::walkthrough::Pace;

    #[test]
    fn what_was_shown_before_all_of_it_had_come_makes_no_trace_and_what_was_shown_again_is_left_out() {
        let settings = Settings::new(Viewport::new(64, 64).unwrap(), LodRule::new(2.0).unwrap());
        let plan = Plan { pace: Pace::Live { hz: 30.0 }, ..Plan::new(settings) };
        let record = |number, again: bool, lacking| FrameRecord {
            camera: Camera::at_origin(FrameNumber(number)),
            culler: None,
            ids: vec![DrawableId(number)],
            for_loss: 0,
            lacking,
            again,
            picture: None,
            published: Duration::ZERO,
            begun: Duration::ZERO,
            drawing: Duration::ZERO,
            shown: Duration::ZERO,
            on_device: Duration::ZERO,
            traffic: SentBytes::default(),
            arrivals: Vec::new(),
            stats: (!again).then(FrameStats::default),
        };
        let trace = |records: &[FrameRecord]| Trace::of(SceneHash(7), &plan, records);
        let whole = trace(&[record(0, false, 0), record(1, true, 0), record(2, false, 0)]).unwrap();
        let ids: Vec<_> = whole.frames().iter().map(|frame| frame.ids[0].0).collect();
        assert_eq!(ids, [0, 2]);
        let error = trace(&[record(0, false, 0), record(1, false, 5)]).unwrap_err();
        assert_eq!(error, RecordError::Loading { frame: FrameNumber(1) });
        assert!(error.to_string().contains("--while-loading wait"), "{error}");
    }

    #[test]
    fn ids_are_found_when_they_were_seen_and_within_the_time_of_culling() {
        let ms = Duration::from_millis;
        let frame = TraceFrame {
            camera: Camera::at_origin(FrameNumber(0)),
            or: ms(1),
            hc: ms(8),
            rvg: ms(1),
            ids: (0..300).map(DrawableId).collect(),
            found: vec![(100, ms(2)), (200, ms(6)), (300, ms(9))],
        };
        let finds: Vec<_> = frame.finds().collect();
        assert_eq!(finds, [(100, ms(2)), (200, ms(6)), (300, ms(8))]);
    }
}
