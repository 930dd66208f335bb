//! A walkthrough: a scene, a path and three roles, and the report of how it went.
//!
//! ```text
//! Trail::find      which way to walk
//! in_process       the three roles walk it; a Recorder notes every frame
//! Auditor          draws frames again, away from the clock: as shown, without culling, at full detail
//! report           all of it as a report with its pictures
//! ```

mod audit;
mod compose;
mod in_process;
mod path;
mod record;
mod reporting;

pub use audit::{AuditError, AuditPictures, Auditor, picture_of};
pub use in_process::{Stage, StageError, in_process};
pub use path::{PathChoice, Trail, TrailError};
pub use record::{FrameRecord, Recorder};
pub use reporting::{ReportPlan, ReportingError, SceneFile, write_report};

use trimaran_cull::Viewport;
use trimaran_proto::{BatchSize, EpsilonPx, PictureSize, Settings, TesterKind};

/// How to walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// The picture's size.
    pub size: PictureSize,
    /// The largest error on the screen.
    pub epsilon: EpsilonPx,
    /// How many ids travel in a batch.
    pub batch: BatchSize,
    /// What tests boxes.
    pub tester: TesterKind,
    /// Every how many frames one is checked against the truth; 0 for none.
    pub audit_every: u32,
    /// Whether audited frames name what is exactly visible at full detail.
    pub visible: bool,
}

impl Plan {
    /// What the display dictates to the pair for a walk of `frames` frames, in lockstep.
    #[must_use]
    pub const fn settings(&self, frames: u32) -> Settings {
        Settings {
            size: self.size,
            epsilon: self.epsilon,
            batch: self.batch,
            tester: self.tester,
            lockstep: true,
            frames: Some(frames),
        }
    }
}

/// The picture's size as the drawing crates take it.
///
/// # Errors
/// Never for a size that exists: both sides are at least 1.
pub fn viewport(size: PictureSize) -> Result<Viewport, trimaran_cull::ViewportError> {
    Viewport::new(size.width(), size.height())
}
