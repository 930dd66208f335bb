//! Walks on the f64 oracle.

use trimaran_audit::{ReferenceWalkthrough, Testing, WalkthroughError, cases::Case};
use trimaran_cull::{LodRule, lod_cut};
use trimaran_proto::FrameNumber;

use super::figures::{Figures, outside, toggles};

/// Frames after which one culler has settled: the first still one has occluders from before.
const SETTLED: usize = 2;

/// Walks a case on the f64 oracle: one culler, and a rasterizer that shares no code with a driver.
///
/// # Errors
/// If the case cannot be walked.
pub fn walk_reference(case: &Case, testing: Testing, rule: LodRule) -> Result<Figures, WalkthroughError> {
    let mut walk = ReferenceWalkthrough::new(case.scene.clone(), rule).testing(testing);
    let mut figures = Figures::default();
    let mut emitted = Vec::with_capacity(case.views.len());
    for view in &case.views {
        let report = walk.frame(view)?;
        let lost = report.false_culled.len() as u64;
        figures.add(FrameNumber(emitted.len() as u32), report.differing_pixels as u64, lost);
        let cut = lod_cut(&case.scene, view, rule);
        figures.outside_cut += outside(&report.emitted, &cut);
        figures.background += report.shown.ids().iter().filter(|id| id.is_none()).count() as u64;
        figures.drawn += report.emitted.len() as u64;
        figures.whole += cut.len() as u64;
        emitted.push(report.emitted);
    }
    let frames = case.views.iter().zip(emitted.iter().map(Vec::as_slice));
    figures.toggles = Some(toggles(frames, SETTLED));
    Ok(figures)
}
