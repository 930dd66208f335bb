//! Live walks: the age of a picture when it is shown, and the error due to it.

use trimaran::{
    comparison::schema::LagPoint,
    report::schema::Stat,
    walkthrough::{CameraPath, FrameRecord},
};
use trimaran_actors::Cameras;
use trimaran_audit::metrics::{ImageRef, flip};
use trimaran_cull::Image;
use trimaran_proto::FrameNumber;

use super::{
    audit::References,
    walks::{Comparing, Mode, plan},
};
use crate::cli::Failure;

/// The number of pictures of a walk whose error is measured.
const SAMPLES: usize = 8;

impl Comparing<'_> {
    /// Walks by the clock with each system at each rate.
    pub(super) fn lag(
        &self,
        epsilon: f64,
        references: &mut References,
        found: &mut Vec<LagPoint>,
    ) -> Result<(), Failure> {
        let Some(first) = self.paths.first() else { return Ok(()) };
        for &hz in &self.args.live {
            for &system in &self.args.systems {
                let plan = plan(self.args, system, epsilon, Mode::Live(hz))?;
                let path = self.path_of(system, epsilon, &first.poses)?;
                let (report, records) = self.recorded(system, &plan, Mode::Live(hz), &path, |_, _| Ok(()))?;
                references.see(&plan);
                let metric = |key: &str| report.summary.metrics.get(key).map(|stat| stat.median);
                let median = |values: Vec<f64>| Stat::of(values).map(|stat| stat.median);
                let errors = errors(references, &path, hz, &records)?;
                found.push(LagPoint {
                    system,
                    poses_per_second: hz,
                    epsilon_px: epsilon,
                    fps: report.summary.measured_fps,
                    lag_ms: metric("latency_ms"),
                    lag_poses: median(records.iter().map(|record| poses_since(record, hz)).collect()),
                    triangles: metric("triangles_drawn"),
                    flip_mean: median(errors),
                });
            }
        }
        Ok(())
    }
}

/// How many poses the path has advanced between a picture's camera and the picture.
fn poses_since(record: &FrameRecord, hz: f64) -> f64 {
    (hz * record.shown.saturating_sub(record.published).as_secs_f64()).round()
}

/// Mean FLIP error of pictures spread over a walk, against the picture that was due when they were shown.
fn errors(
    references: &mut References,
    path: &CameraPath,
    hz: f64,
    records: &[FrameRecord],
) -> Result<Vec<f64>, Failure> {
    let mut cameras = path.clone();
    let (mut shown, mut due) = (Image::default(), Image::default());
    let mut errors = Vec::new();
    for record in records.iter().step_by(records.len().div_ceil(SAMPLES).max(1)) {
        let Some(pose) = path.index_of(&record.camera) else { continue };
        let pose = pose as f64 + poses_since(record, hz);
        // Past its end the walk stands still.
        let now = cameras.camera(FrameNumber(pose as u32));
        let auditor = &mut references.auditor;
        auditor.unculled(record.camera, &mut shown).map_err(Failure::broken)?;
        auditor.unculled(now, &mut due).map_err(Failure::broken)?;
        let of = |image| ImageRef::of(image).map_err(Failure::broken);
        errors.push(flip(&of(&due)?, &of(&shown)?).map_err(Failure::broken)?.mean());
    }
    Ok(errors)
}
