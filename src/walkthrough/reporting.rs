//! From a session to a report on disk, however the session ended.

use std::{ops::ControlFlow, path::PathBuf, sync::Arc, time::SystemTime};

use trimaran_actors::{RoleError, SessionError};
use trimaran_audit::metrics::ImageRef;
use trimaran_cull::Image;
use trimaran_gpu::{GpuInfo, GpuScene};
use trimaran_scene::Scene;
use trimaran_transport::causes;

use super::{
    audit::{AuditPictures, Auditor},
    compose::{Composer, FrameRecord},
    error::ReportingError,
    journal::Journal,
    path::CameraPath,
    plan::{Pace, Plan},
};
use crate::report::{
    Frame, Paths, PictureKind, Projection, Report, ReportError, Run, Writer,
    schema::{Ended, HowEnded, Machine, Mode, RoleInfo, SceneInfo, timestamp},
};
use crate::vulkan::VulkanCuller;

/// A scene and the file it came from.
#[derive(Debug, Clone)]
pub struct SceneFile {
    /// The cooked file.
    pub path: PathBuf,
    /// What is in it.
    pub scene: Arc<Scene>,
}

/// What a report says of the run beside its frames.
#[derive(Debug, Clone)]
pub struct ReportPlan {
    /// The command line, the program first.
    pub command_line: Vec<String>,
    /// When the run began.
    pub started: SystemTime,
    /// `inproc` or `tcp`.
    pub link: String,
    /// The transport in words.
    pub transport: String,
    /// `auto`, or the path's file.
    pub path: String,
    /// The seed of an automatic path.
    pub seed: Option<u64>,
    /// The roles' devices.
    pub devices: Vec<(Machine, GpuInfo)>,
    /// Remarks that belong beside every figure.
    pub notes: Vec<String>,
}

/// Begins to record a walk into a report's folder.
///
/// # Errors
/// When it cannot be written to, or the system gives no thread.
pub fn begin(
    mut writer: Writer,
    file: &SceneFile,
    plan: &Plan,
    about: &ReportPlan,
    path: &CameraPath,
) -> Result<Journal, ReportingError> {
    writer.begin(&report(file, plan, about, path, &[], Vec::new(), Ended::default()))?;
    Journal::start(writer, Composer::new(&file.scene, path, plan.alone)).map_err(ReportingError::Thread)
}

/// How a session ended that a role or the journal ended early.
#[must_use]
pub fn how_ended(error: &SessionError) -> HowEnded {
    match error {
        SessionError::Culler { cause, .. } => how_ended(cause),
        SessionError::Lost { .. } => HowEnded::PeerLost,
        SessionError::Role(RoleError::Stopped) => HowEnded::Interrupted,
        SessionError::Role(RoleError::Observer(_)) => HowEnded::NotRecorded,
        SessionError::Role(error) if error.device_failure().is_some() => HowEnded::DeviceFailed,
        SessionError::Role(error) if error.lost_a_peer() => HowEnded::PeerLost,
        _ => HowEnded::Failed,
    }
}

/// A report on disk.
#[derive(Debug)]
pub struct Written {
    /// What it says.
    pub report: Report,
    /// Where it lies.
    pub paths: Paths,
    /// Why it has not all the pictures and checks that were asked for, if so.
    pub incomplete: Option<ReportingError>,
}

/// Audits the session's frames, draws the pictures that `writer` has not got yet, and writes the report.
/// Calls `progress` after each frame, and draws no more if it says so. After `failure`, with which the folder
/// took no more, nothing more is drawn.
///
/// # Errors
/// When the disk fails. Whatever else does, the report is written with what there is, and says what is
/// missing.
#[expect(clippy::too_many_arguments, reason = "a report joins this many things")]
pub fn write_report(
    mut writer: Writer,
    failure: Option<ReportingError>,
    file: &SceneFile,
    drawn: &Arc<GpuScene>,
    plan: &Plan,
    mut about: ReportPlan,
    path: &CameraPath,
    records: &[FrameRecord],
    ended: Ended,
    progress: &mut dyn FnMut(u32) -> ControlFlow<()>,
) -> Result<Written, ReportError> {
    let mut composer = Composer::new(&file.scene, path, plan.alone);
    let mut frames: Vec<Frame> = records.iter().map(|record| composer.frame(record)).collect();
    let mut checked = 0;
    let incomplete = match failure {
        Some(failure) => Some(failure),
        None => {
            let mut count = |frame| {
                checked += 1;
                progress(frame)
            };
            draw(&mut writer, file, drawn, plan, records, &mut frames, &mut count).err()
        }
    };
    if let Some(why) = &incomplete {
        let why = causes(why);
        about
            .notes
            .push(format!("pictures and checks end after {checked} of {} frames: {why}", frames.len()));
    }
    let report = report(file, plan, &about, path, records, frames, ended);
    let paths = writer.finish(report.clone())?;
    Ok(Written { report, paths, incomplete })
}

/// Draws the frames' pictures and audits those that are due.
fn draw(
    writer: &mut Writer,
    file: &SceneFile,
    drawn: &Arc<GpuScene>,
    plan: &Plan,
    records: &[FrameRecord],
    frames: &mut [Frame],
    progress: &mut dyn FnMut(u32) -> ControlFlow<()>,
) -> Result<(), ReportingError> {
    let rule = plan.lod;
    let mut auditor = Auditor::new(&file.scene, drawn, plan.viewport, rule)?;
    let mut machine = VulkanCuller::new(drawn, plan.viewport, plan.occlusion_test)?;
    let mut pictures = AuditPictures::default();
    for (index, (frame, record)) in frames.iter_mut().zip(records).enumerate() {
        let number = frame.frame;
        if plan.audit_every > 0 && number.is_multiple_of(plan.audit_every) {
            let walk = records.get(..=index).unwrap_or_default();
            auditor.audit(&mut machine, walk, plan.visible, frame, &mut pictures)?;
            for (kind, picture) in [
                (PictureKind::Shown, &pictures.shown),
                (PictureKind::Unculled, &pictures.unculled),
                (PictureKind::Full, &pictures.full),
            ] {
                // The picture as shown was written when it was shown, if it was read back then.
                if !writer.has(number, kind) {
                    write_picture(writer, number, kind, picture)?;
                }
            }
        } else {
            auditor.picture(record, &mut pictures.shown)?;
            write_picture(writer, number, PictureKind::Shown, &pictures.shown)?;
        }
        if progress(number).is_break() {
            return Err(ReportingError::Interrupted);
        }
    }
    Ok(())
}

fn write_picture(
    writer: &mut Writer,
    frame: u32,
    kind: PictureKind,
    picture: &Image,
) -> Result<(), ReportingError> {
    Ok(writer.picture(frame, kind, &ImageRef::of(picture)?)?)
}

fn report(
    file: &SceneFile,
    plan: &Plan,
    about: &ReportPlan,
    path: &CameraPath,
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
    Report::new(run(file, plan, about), projection, frames, wall_ms, ended)
}

fn run(file: &SceneFile, plan: &Plan, about: &ReportPlan) -> Run {
    let role = |(machine, info): &(Machine, GpuInfo)| RoleInfo {
        machine: *machine,
        device: info.name.clone(),
        driver: info.driver.clone(),
    };
    Run {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        command_line: about.command_line.clone(),
        started: timestamp(about.started),
        roles: about.devices.iter().map(role).collect(),
        scene: scene_info(file),
        epsilon_px: plan.lod.epsilon_px(),
        occlusion_test: plan.occlusion_test.name().to_owned(),
        batch: u32::try_from(plan.batch.items()).unwrap_or(u32::MAX),
        coding: Some(plan.coding.name().to_owned()),
        link: about.link.clone(),
        transport: about.transport.clone(),
        mode: match plan.pace {
            Pace::Lockstep => Mode::Lockstep,
            Pace::Live { .. } => Mode::Live,
        },
        alone: plan.alone,
        path: about.path.clone(),
        seed: about.seed,
        audit_every: (plan.audit_every > 0).then_some(plan.audit_every),
        notes: about.notes.clone(),
    }
}

fn scene_info(file: &SceneFile) -> SceneInfo {
    let scene = &file.scene;
    SceneInfo {
        file: file.path.display().to_string(),
        hash: scene.hash().to_string(),
        file_bytes: std::fs::metadata(&file.path).ok().map(|data| data.len()),
        objects: scene.objects().len() as u64,
        nodes: scene.nodes().len() as u64,
        drawables: scene.drawables().len() as u64,
        triangles: scene.full_detail_triangles(),
        sources: scene.sources().to_vec(),
    }
}
