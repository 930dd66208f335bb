//! Walks a trial on the CPU, in f64.

use std::sync::Arc;

use trimaran_cull::{CutRule, LodRule};
use trimaran_proto::OcclusionTestKind;

use super::{Trial, TrialError};
use crate::{Fault, ReferenceWalkthrough, Testing};

/// The changes that culling made to a walk.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Verdict {
    /// Frames that were walked.
    pub frames: u64,
    /// Pixels that show another triangle than without culling.
    pub wrong_pixels: u64,
    /// Drawables that own a pixel without culling, and were not drawn.
    pub lost: u64,
    /// Boxes that were found hidden. A search that hides little shows little.
    pub hidden: u64,
}

impl Verdict {
    /// Whether culling changed nothing.
    #[must_use]
    pub const fn is_sound(&self) -> bool {
        self.wrong_pixels == 0 && self.lost == 0
    }
}

/// Walks a trial by the reference. A fault breaks one of the conditions of exact culling.
///
/// # Errors
/// If the trial is malformed.
pub fn judge(trial: &Trial, testing: Testing, fault: Fault) -> Result<Verdict, TrialError> {
    let scene = trial.scene()?;
    let mut verdict = Verdict::default();
    let first = LodRule::new(1.0)?;
    let mut walk = ReferenceWalkthrough::new(Arc::clone(&scene), first).testing(testing).with_fault(fault);
    for (number, frame) in (0..).zip(&trial.frames) {
        let state = frame.view_state(OcclusionTestKind::Raster)?;
        walk.set_rule(CutRule::new(&scene, &state));
        let report = walk.frame(&frame.view(number)?)?;
        verdict.frames += 1;
        verdict.wrong_pixels += report.differing_pixels as u64;
        verdict.hidden += u64::from(report.stats.counts.hidden);
        verdict.lost += report.false_culled.len() as u64;
    }
    Ok(verdict)
}
