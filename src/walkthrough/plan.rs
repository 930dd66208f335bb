//! How to walk.

use trimaran_actors::Schedule;
use trimaran_proto::{BatchSize, IdCoding, LodRule, OcclusionTestKind, Settings, Viewport};

use crate::culling::CullingMethod;

/// How the poses of a path become frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// Every pose is one frame: the same frames each time.
    Lockstep,
    /// The path is walked by the clock, and a frame shows the newest pose there is when its machine begins
    /// it.
    Live {
        /// Poses of the path a second, above 0.
        hz: f64,
    },
}

/// How to walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// The picture's size.
    pub viewport: Viewport,
    /// When a level of detail is good enough. A rule that stops at few pixels needs an occlusion test that
    /// counts them.
    pub lod: LodRule,
    /// How many ids travel in a batch.
    pub batch: BatchSize,
    /// How ids travel between processes.
    pub coding: IdCoding,
    /// How what is visible is found. Cullers on other machines decide it for themselves.
    pub culling: CullingMethod,
    /// What tests boxes.
    pub occlusion_test: OcclusionTestKind,
    /// How poses become frames.
    pub pace: Pace,
    /// Which visible set cullers draw their occluders from.
    pub schedule: Schedule,
    /// Every how many frames one is checked against the truth; 0 for none.
    pub audit_every: u32,
    /// Whether audited frames name what is exactly visible at full detail.
    pub visible: bool,
    /// Whether the roles compute one after another, so that no busy time contains another role's work. Only
    /// roles of one process can: it has no effect on others.
    pub alone: bool,
}

impl Plan {
    /// What the display decides for the cullers.
    #[must_use]
    pub const fn settings(&self) -> Settings {
        Settings {
            viewport: self.viewport,
            lod: self.lod,
            batch: self.batch,
            coding: self.coding,
            occlusion_test: self.occlusion_test,
        }
    }

    /// Which frames a walk of `poses` poses has. A live one has as many as there is time for.
    #[must_use]
    pub const fn frames(&self, poses: u32) -> trimaran_actors::Pace {
        match self.pace {
            Pace::Lockstep => trimaran_actors::Pace::Lockstep { frames: Some(poses) },
            Pace::Live { .. } => trimaran_actors::Pace::Live,
        }
    }

    /// How many frames a walk of `poses` poses has; none if it is walked by the clock.
    #[must_use]
    pub const fn frames_due(&self, poses: u32) -> Option<u32> {
        match self.pace {
            Pace::Lockstep => Some(poses),
            Pace::Live { .. } => None,
        }
    }
}
