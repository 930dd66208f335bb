//! The data needed to draw and check a walk's pictures later, for a walk that was stopped.

use std::{collections::BTreeSet, fs, io, path::Path};

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_actors::UnknownSchedule;
use trimaran_proto::{Settings, ViewState};
use trimaran_scene::{
    Scene,
    path::{PathError, PosePath},
};

use super::{
    compose::FrameRecord,
    path::{CameraPath, CameraPathError},
    plan::{Pace, Plan},
    reporting::Walk,
    resume::{FrameState, Keeper},
    view_states::{ViewChange, ViewStates},
};
use crate::report::{ReportError, Run, UNCHECKED, Writer, schema::Ended};

/// A walk whose report lacks some pictures and checks. It lies beside the report as `unchecked.json`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Unchecked {
    /// The run.
    pub run: Run,
    /// How the walk ended.
    pub ended: Ended,
    settings: Settings,
    /// Poses of the path a second, of a live walk.
    live_hz: Option<f64>,
    visible: bool,
    /// The poses in the format of a path file, and the number of frames of the path.
    path: String,
    frames: u32,
    later_views: Vec<(u32, ViewState)>,
    records: Vec<FrameState>,
}

/// Why a report cannot be completed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum UncheckedError {
    /// The file is missing: the report is complete.
    #[error(
        "cannot read {path}: {cause}: a folder has this file where a walk was stopped before its report was whole"
    )]
    Read {
        /// The file.
        path: String,
        /// The cause.
        #[source]
        cause: io::Error,
    },
    /// The file is invalid.
    #[error("{path} is not what this version of trimaran leaves beside a report that lacks something")]
    Format {
        /// The file.
        path: String,
        /// The cause.
        #[source]
        cause: serde_json::Error,
    },
    /// The scene is another one, or has changed.
    #[error(
        "the walk was through the scene {walked}, and {file} is {found}: name the right file with --scene"
    )]
    Scene {
        /// The file.
        file: String,
        /// The fingerprint of the scene that was walked.
        walked: String,
        /// The fingerprint of the file's scene.
        found: String,
    },
    /// The schedule of cullers is unknown.
    #[error(transparent)]
    Schedule(#[from] UnknownSchedule),
    /// The path is invalid.
    #[error("the walk's path cannot be read")]
    Path(#[from] PathError),
    /// A pose of the path makes no valid camera.
    #[error(transparent)]
    Camera(#[from] CameraPathError),
    /// A frame does not fit the scene and the path.
    #[error("frame {0} of the walk cannot be read")]
    Frame(usize),
}

impl Unchecked {
    pub(super) fn of(walk: Walk<'_>, run: Run, ended: Ended, records: &[FrameRecord]) -> Self {
        let Walk { plan, path, .. } = walk;
        let mut keeper = Keeper::after(&[], path);
        let later = path.views().later().iter();
        Self {
            run,
            ended,
            settings: plan.settings(),
            live_hz: match plan.pace {
                Pace::Lockstep => None,
                Pace::Live { hz } => Some(hz),
            },
            visible: plan.visible,
            path: path.poses().to_json(),
            frames: path.frames(),
            later_views: later.map(|change| (change.pose, (*change.state).clone())).collect(),
            records: records.iter().map(|record| keeper.keep(record)).collect(),
        }
    }

    pub(super) fn keep(&self, writer: &mut Writer) -> Result<(), ReportError> {
        writer.keep(self)
    }

    /// Reads the file beside the report in a folder.
    ///
    /// # Errors
    /// When it does not exist or cannot be read.
    pub fn read(folder: &Path) -> Result<Self, UncheckedError> {
        let path = folder.join(UNCHECKED);
        let name = path.display().to_string();
        let text = fs::read(&path).map_err(|cause| UncheckedError::Read { path: name.clone(), cause })?;
        serde_json::from_slice(&text).map_err(|cause| UncheckedError::Format { path: name, cause })
    }

    /// The settings of the walk.
    ///
    /// # Errors
    /// When this version does not support them.
    pub fn plan(&self) -> Result<Plan, UncheckedError> {
        Ok(Plan {
            culling: self.run.culling,
            pace: self.live_hz.map_or(Pace::Lockstep, |hz| Pace::Live { hz }),
            schedule: self.run.schedule.parse()?,
            audit_every: self.run.audit_every.unwrap_or(0),
            visible: self.visible,
            alone: self.run.alone,
            ..Plan::new(self.settings)
        })
    }

    /// The path through this scene of `file`.
    ///
    /// # Errors
    /// When it is another scene, or the path is invalid.
    pub fn path(&self, scene: &Scene, file: &Path) -> Result<CameraPath, UncheckedError> {
        let (walked, found) = (self.run.scene.hash.clone(), scene.hash().to_string());
        if walked != found {
            return Err(UncheckedError::Scene { file: file.display().to_string(), walked, found });
        }
        let later = self.later_views.iter();
        let later =
            later.map(|(pose, state)| ViewChange { pose: *pose, state: state.clone().into() }).collect();
        let views = ViewStates::new(self.settings.into(), later);
        let poses = PosePath::from_json(&self.path)?;
        Ok(CameraPath::of(poses, scene, views, Some(self.frames))?)
    }

    /// The records of the shown frames.
    ///
    /// # Errors
    /// When a frame does not fit the scene and the path.
    pub fn records(&self, scene: &Scene, path: &CameraPath) -> Result<Vec<FrameRecord>, UncheckedError> {
        let mut last = BTreeSet::new();
        let states = self.records.iter().enumerate();
        let record = |(number, state): (usize, &FrameState)| {
            state.record(scene, path, number, &mut last).ok_or(UncheckedError::Frame(number))
        };
        states.map(record).collect()
    }
}
