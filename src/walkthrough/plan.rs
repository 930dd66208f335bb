//! The settings of a walk.

use trimaran_actors::Schedule;
use trimaran_proto::{BatchSize, IdCoding, LodRule, OcclusionTestKind, Settings, Viewport};

use crate::culling::CullingMethod;

/// How the poses of a path become frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// Every pose is one frame: the same frames each time.
    Lockstep,
    /// The path is walked by the clock. A frame shows the newest pose at the time when its machine begins it.
    Live {
        /// Poses of the path a second, above 0.
        hz: f64,
    },
}

/// The settings of a walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// The picture's size.
    pub viewport: Viewport,
    /// The rule for levels of detail. If it stops at few pixels, the occlusion test must count them.
    pub lod: LodRule,
    /// How many ids travel in a batch.
    pub batch: BatchSize,
    /// How ids travel between processes.
    pub coding: IdCoding,
    /// The culling method. Cullers on other machines choose their own.
    pub culling: CullingMethod,
    /// The occlusion test of boxes.
    pub occlusion_test: OcclusionTestKind,
    /// How poses become frames.
    pub pace: Pace,
    /// The visible set from which cullers draw their occluders.
    pub schedule: Schedule,
    /// Every this many frames one is audited; 0 for none.
    pub audit_every: u32,
    /// Whether audited frames list the exactly visible objects at full detail.
    pub visible: bool,
    /// Whether the roles compute one after another, so that no busy time contains another role's work. Has an
    /// effect only on roles of one process.
    pub alone: bool,
}

impl Plan {
    /// A walk in lockstep with these settings, culled by Trimaran's method, without audits.
    #[must_use]
    pub const fn new(settings: Settings) -> Self {
        let Settings { viewport, lod, batch, coding, occlusion_test } = settings;
        Self {
            viewport,
            lod,
            batch,
            coding,
            culling: CullingMethod::Trimaran,
            occlusion_test,
            pace: Pace::Lockstep,
            schedule: Schedule::Independent,
            audit_every: 0,
            visible: false,
            alone: false,
        }
    }

    /// The settings that the display imposes on the cullers.
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

    /// Whether this frame is to be audited.
    #[must_use]
    pub const fn is_audit_due(&self, frame: u32) -> bool {
        self.audit_every > 0 && frame.is_multiple_of(self.audit_every)
    }

    /// The frames of a walk of `poses` poses. A live one has as many as time allows.
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
