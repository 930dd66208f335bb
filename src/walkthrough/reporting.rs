//! Writes the report of a session, however the session ended.

use std::{path::PathBuf, sync::Arc};

use trimaran_actors::{RoleError, SessionError};
use trimaran_cull::Image;
use trimaran_gpu::GpuScene;
use trimaran_scene::Scene;
use trimaran_transport::causes;

use super::{
    compose::{Composer, FrameRecord},
    error::ReportingError,
    journal::Journal,
    path::CameraPath,
    plan::{Pace, Plan},
    redraw::GivesUp,
    resume::{Keeper, Progress},
    unchecked::Unchecked,
    view_states::{ViewChange, ViewStates},
};
use crate::report::{
    Frame, Paths, PictureKind, Projection, Report, ReportError, Run, Writer,
    schema::{Ended, HowEnded, MemoryUse, Mode, SceneInfo, ViewStateInfo},
};

/// A scene and the file it came from.
#[derive(Debug, Clone)]
pub struct SceneFile {
    /// The cooked file.
    pub path: PathBuf,
    /// Its content.
    pub scene: Arc<Scene>,
}

/// A scene on a device, and the path through it.
#[derive(Debug, Clone, Copy)]
pub struct Walk<'w> {
    /// The scene.
    pub file: &'w SceneFile,
    /// The same on the display's device.
    pub drawn: &'w Arc<GpuScene>,
    /// The settings.
    pub plan: &'w Plan,
    /// The path.
    pub path: &'w CameraPath,
}

/// Begins or resumes recording a walk into a report's folder. With `progress` it can be resumed if this
/// process is killed.
///
/// # Errors
/// When it cannot be written to, or the system gives no thread.
pub fn begin(
    mut writer: Writer,
    walk: Walk<'_>,
    run: Run,
    progress: Option<&Progress>,
) -> Result<Journal, ReportingError> {
    let before = progress.map(|progress| progress.records.as_slice()).unwrap_or_default();
    if before.is_empty() {
        let state = progress.map(|progress| progress.state(walk));
        writer.begin(&report(walk, run, &[], Vec::new(), Ended::default()), state.as_ref())?;
    }
    let keeper = progress.map(|_| Keeper::after(before, walk.path));
    Journal::start(writer, walk.composer(before), keeper).map_err(ReportingError::Thread)
}

/// Why a role or the journal ended a session early.
#[must_use]
pub fn how_ended(error: &SessionError) -> HowEnded {
    match error {
        SessionError::Role(RoleError::Stopped) => HowEnded::Interrupted,
        SessionError::Role(RoleError::Observer(_)) => HowEnded::NotRecorded,
        SessionError::Role(error) if error.device_failure().is_some() => HowEnded::DeviceFailed,
        _ => HowEnded::Failed,
    }
}

/// A report on disk.
#[derive(Debug)]
pub struct Written {
    /// Its content.
    pub report: Report,
    /// Its paths.
    pub paths: Paths,
    /// Why pictures or checks are missing, if so.
    pub incomplete: Option<ReportingError>,
}

/// Audits the session's frames, draws the pictures that `writer` lacks, and writes the report. Calls
/// `progress` after each frame, and stops drawing soon after `is_given_up` says so. After `failure` of
/// writing to the folder, nothing more is drawn.
///
/// # Errors
/// When the disk fails. After other errors the report is written as far as possible, and lists its gaps; the
/// data to [complete it later](Unchecked) lies beside it.
#[expect(clippy::too_many_arguments, reason = "what a walk has left, and how its report is watched")]
pub fn write_report(
    mut writer: Writer,
    failure: Option<ReportingError>,
    walk: Walk<'_>,
    mut run: Run,
    records: &[FrameRecord],
    ended: Ended,
    progress: &mut dyn FnMut(u32),
    is_given_up: &GivesUp,
) -> Result<Written, ReportError> {
    // Measured before pictures are drawn once more.
    run.memory.get_or_insert_with(|| memory_use(&walk.file.scene, walk.drawn));
    let mut composer = walk.composer(&[]);
    let mut frames: Vec<Frame> = records.iter().map(|record| composer.frame(record)).collect();
    let mut checked = 0;
    let incomplete = match failure {
        Some(failure) => Some(failure),
        // Some of the geometry that its cullers sent may be gone: only pictures that were read back remain.
        None if !walk.file.scene.is_whole() => None,
        None => {
            let mut count = |frame| {
                checked += 1;
                progress(frame);
            };
            let drawn = draw(&mut writer, walk, records, &mut frames, &mut count, is_given_up);
            let missing = drawn.err().map(|e| if is_given_up() { ReportingError::Interrupted } else { e });
            if missing.is_some() {
                let unchecked = Unchecked::of(walk, run.clone(), ended.clone(), records);
                // A full disk has room only for the report.
                let _less_is_left = unchecked.keep(&mut writer);
            }
            missing
        }
    };
    if let Some(why) = &incomplete {
        let why = causes(why);
        run.notes.push(format!("pictures and checks end after {checked} of {} frames: {why}", frames.len()));
    }
    let report = report(walk, run, records, frames, ended);
    let paths = writer.finish(report.clone())?;
    Ok(Written { report, paths, incomplete })
}

/// Draws the frames' pictures, and audits frames that are due.
fn draw(
    writer: &mut Writer,
    walk: Walk<'_>,
    records: &[FrameRecord],
    frames: &mut [Frame],
    progress: &mut dyn FnMut(u32),
    is_given_up: &GivesUp,
) -> Result<(), ReportingError> {
    #[cfg(feature = "lab")]
    let mut redrawer = super::audit::DueAudits::new(walk)?;
    #[cfg(not(feature = "lab"))]
    let mut redrawer = super::redraw::Redrawer::new(&walk.file.scene, walk.drawn, walk.path.views().clone())?;
    redrawer.give_up_when(Arc::clone(is_given_up));
    let mut picture = Image::default();
    for (place, record) in records.iter().enumerate() {
        let Some(frame) = frames.get_mut(place) else { break };
        let number = frame.frame;
        if is_given_up() {
            return Err(ReportingError::Interrupted);
        }
        #[cfg(feature = "lab")]
        if walk.plan.is_audit_due(number) {
            redrawer.audit(records.get(..=place).unwrap_or_default(), frame, writer)?;
            progress(number);
            continue;
        }
        redrawer.picture(record, &mut picture)?;
        writer.picture(number, PictureKind::Shown, &picture)?;
        progress(number);
    }
    Ok(())
}

/// A walk as a report that is not written: `audit` enters the results of audits into its frames.
pub fn report_of(
    walk: Walk<'_>,
    run: Run,
    records: &[FrameRecord],
    mut audit: impl FnMut(&FrameRecord, &mut Frame),
) -> Report {
    let mut composer = walk.composer(&[]);
    let frame = |record: &FrameRecord| {
        let mut frame = composer.frame(record);
        audit(record, &mut frame);
        frame
    };
    let frames = records.iter().map(frame).collect();
    let due = walk.plan.frames_due(walk.path.frames());
    report(walk, run, records, frames, Ended::finished(due))
}

fn report(
    Walk { plan, path, .. }: Walk<'_>,
    run: Run,
    records: &[FrameRecord],
    frames: Vec<Frame>,
    ended: Ended,
) -> Report {
    let projection = Projection {
        width: plan.viewport.width(),
        height: plan.viewport.height(),
        vfov_deg: path.vfov_deg(),
        near: path.near().into(),
    };
    let wall_ms = match records {
        [first, .., last] => Some(last.shown.saturating_sub(first.shown).as_secs_f64() * 1e3),
        _ => None,
    };
    Report::new(run, projection, frames, wall_ms, ended)
}

impl Walk<'_> {
    /// A report's description of the run beside its frames, as far as the walk determines it.
    #[must_use]
    pub fn run(&self) -> Run {
        let plan = self.plan;
        Run {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene: scene_info(self.file),
            epsilon_px: plan.lod.epsilon_px(),
            culling: plan.culling,
            occlusion_test: plan.occlusion_test.name().to_owned(),
            batch: u32::try_from(plan.batch.items()).unwrap_or(u32::MAX),
            coding: Some(plan.coding.name().to_owned()),
            mode: match plan.pace {
                Pace::Lockstep => Mode::Lockstep,
                Pace::Live { .. } => Mode::Live,
            },
            alone: plan.alone,
            view_states: view_states(self.path.views()),
            audit_every: (plan.audit_every > 0).then_some(plan.audit_every),
            ..Run::default()
        }
    }

    fn composer(&self, before: &[FrameRecord]) -> Composer {
        Composer::new(&self.file.scene, self.path, self.plan.alone, before)
    }
}

/// The memory that a display uses for a scene now.
#[must_use]
pub fn memory_use(scene: &Scene, drawn: &GpuScene) -> MemoryUse {
    let set = drawn.working_set();
    MemoryUse {
        scene_bytes: scene.resident_bytes(),
        device_taken_bytes: set.taken_bytes,
        device_bytes: set.resident_bytes,
        pieces_brought: set.loaded,
        bytes_brought: set.loaded_bytes,
        pieces_dropped: set.dropped,
    }
}

fn view_states(views: &ViewStates) -> Vec<ViewStateInfo> {
    let info = |(version, ViewChange { pose, state }): (u32, &ViewChange)| ViewStateInfo {
        version,
        from_frame: *pose,
        width: state.viewport.width(),
        height: state.viewport.height(),
        epsilon_px: state.lod.epsilon_px(),
        occlusion_test: state.occlusion_test.name().to_owned(),
        sections: state.sections.iter().count() as u64,
        hidden: state.hidden.len() as u64,
        isolated: state.isolated.as_ref().map(|set| set.len() as u64),
        see_through: state.see_through.as_ref().map(|set| set.len() as u64),
    };
    (1..).zip(views.later()).map(info).collect()
}

/// A report's description of a scene.
#[must_use]
pub fn scene_info(file: &SceneFile) -> SceneInfo {
    let scene = &file.scene;
    SceneInfo {
        file: file.path.display().to_string(),
        hash: scene.hash().to_string(),
        file_bytes: std::fs::metadata(&file.path).ok().map(|data| data.len()),
        objects: scene.objects().len() as u64,
        nodes: scene.nodes().len() as u64,
        drawables: scene.drawables().len() as u64,
        triangles: scene.totals().full_detail_triangles,
        sources: scene.sources().to_vec(),
    }
}
