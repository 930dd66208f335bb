//! From a finished session to a report on disk.

use std::{
    ops::ControlFlow,
    path::{Path, PathBuf},
    sync::Arc,
    time::SystemTime,
};

use thiserror::Error;
use trimaran_actors::VulkanPair;
use trimaran_cull::{CutRule, CutRuleError, ViewportError};
use trimaran_gpu::{GpuError, GpuInfo, GpuScene, Picture};
use trimaran_scene::Scene;

use super::{
    Pace, Plan,
    audit::{AuditError, AuditPictures, Auditor, picture_of},
    compose,
    path::Trail,
    record::FrameRecord,
    viewport,
};
use crate::report::{
    Frame, Lens, Paths, PictureKind, Report, ReportError, Run, Writer,
    metrics::MetricError,
    schema::{Mode, RoleInfo, SceneInfo, Seat, timestamp},
};

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
    pub devices: Vec<(Seat, GpuInfo)>,
    /// Remarks that belong beside every figure.
    pub notes: Vec<String>,
}

/// Why there is no report.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportingError {
    /// A device failed.
    #[error("drawing the report's pictures failed")]
    Gpu(#[from] GpuError),
    /// A frame could not be checked.
    #[error(transparent)]
    Audit(#[from] AuditError),
    /// It was broken off.
    #[error("interrupted: no report was written")]
    Interrupted,
    /// Writing failed.
    #[error(transparent)]
    Write(#[from] ReportError),
    /// The picture has no pixels.
    #[error(transparent)]
    Viewport(#[from] ViewportError),
    /// The error bound is none.
    #[error(transparent)]
    Rule(#[from] CutRuleError),
    /// A picture does not fit its size.
    #[error(transparent)]
    Metric(#[from] MetricError),
}

/// Audits the session's frames, draws all its pictures and writes the report into `out`. Calls `progress` after each frame, and
/// stops if it says so.
///
/// # Errors
/// When a device fails, the disk does, or `progress` breaks it off; then nothing of the report is left.
#[expect(clippy::too_many_arguments, reason = "a report joins this many things")]
pub fn write_report(
    out: &Path,
    file: &SceneFile,
    drawn: &Arc<GpuScene>,
    plan: &Plan,
    about: &ReportPlan,
    trail: &Trail,
    records: &[FrameRecord],
    progress: &mut dyn FnMut(u32) -> ControlFlow<()>,
) -> Result<(Report, Paths), ReportingError> {
    let size = viewport(plan.size)?;
    let rule = CutRule::new(plan.epsilon.pixels())?.stopping_at_few_pixels(plan.few_pixels);
    let mut auditor = Auditor::new(&file.scene, drawn, size, rule)?;
    let mut machine = VulkanPair::new(drawn, size, plan.tester)?;
    let mut writer = Writer::create(out)?;
    let mut frames = compose::frames(&file.scene, trail, records, plan.alone);
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
                write_picture(&mut writer, number, kind, picture)?;
            }
        } else {
            auditor.picture(record, &mut pictures.shown)?;
            write_picture(&mut writer, number, PictureKind::Shown, &pictures.shown)?;
        }
        if progress(number).is_break() {
            return Err(ReportingError::Interrupted);
        }
    }
    let report = report(file, plan, about, trail, records, frames);
    let paths = writer.finish(report.clone())?;
    Ok((report, paths))
}

fn write_picture(
    writer: &mut Writer,
    frame: u32,
    kind: PictureKind,
    picture: &Picture,
) -> Result<(), ReportingError> {
    Ok(writer.picture(frame, kind, &picture_of(picture)?)?)
}

fn report(
    file: &SceneFile,
    plan: &Plan,
    about: &ReportPlan,
    trail: &Trail,
    records: &[FrameRecord],
    frames: Vec<Frame>,
) -> Report {
    let lens = Lens {
        width: plan.size.width(),
        height: plan.size.height(),
        vfov_deg: trail.vfov_deg(),
        near: trail.near().into(),
    };
    let wall_ms = match records {
        [first, .., last] => Some(last.shown.saturating_sub(first.shown).as_secs_f64() * 1e3),
        _ => None,
    };
    Report::new(run(file, plan, about), lens, frames, wall_ms)
}

fn run(file: &SceneFile, plan: &Plan, about: &ReportPlan) -> Run {
    let role = |(seat, info): &(Seat, GpuInfo)| RoleInfo {
        seat: *seat,
        device: info.name.clone(),
        driver: info.driver.clone(),
    };
    Run {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        command_line: about.command_line.clone(),
        started: timestamp(about.started),
        roles: about.devices.iter().map(role).collect(),
        scene: scene_info(file),
        epsilon_px: plan.epsilon.pixels(),
        tester: plan.tester.name().to_owned(),
        batch: u32::try_from(plan.batch.ids()).unwrap_or(u32::MAX),
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
        triangles_unique: None,
        sources: scene.sources().to_vec(),
    }
}
