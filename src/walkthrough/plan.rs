//! How to walk.

use trimaran_proto::{BatchSize, EpsilonPx, FrameNumber, IdCoding, PictureSize, Settings, TesterKind};

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
    pub size: PictureSize,
    /// The largest error on the screen.
    pub epsilon: EpsilonPx,
    /// How many ids travel in a batch.
    pub batch: BatchSize,
    /// How ids travel between processes.
    pub coding: IdCoding,
    /// What tests boxes.
    pub tester: TesterKind,
    /// How poses become frames.
    pub pace: Pace,
    /// Whether culling stops at nodes that show at fewer pixels than epsilon (paper, section 4.5.2). Needs a
    /// tester that counts pixels.
    pub few_pixels: bool,
    /// Every how many frames one is checked against the truth; 0 for none.
    pub audit_every: u32,
    /// Whether audited frames name what is exactly visible at full detail.
    pub visible: bool,
    /// Whether the roles compute one after another, so that no busy time contains another role's work. Only
    /// roles of one process can: it has no effect on others.
    pub alone: bool,
}

impl Plan {
    /// What the display dictates to the cullers for a walk of `frames` poses. A live session has as many
    /// frames as there is time for.
    #[must_use]
    pub const fn settings(&self, frames: u32) -> Settings {
        Settings {
            size: self.size,
            epsilon: self.epsilon,
            batch: self.batch,
            coding: self.coding,
            tester: self.tester,
            lockstep: matches!(self.pace, Pace::Lockstep),
            few_pixels: self.few_pixels,
            first: FrameNumber(0),
            frames: match self.pace {
                Pace::Lockstep => Some(frames),
                Pace::Live { .. } => None,
            },
        }
    }
}
