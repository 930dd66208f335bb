//! How a walk ended.

use serde::{Deserialize, Serialize};

/// How a walk ended, and why where it ended early.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ended {
    /// How.
    pub how: HowEnded,
    /// Why, in words; `null` for a walk that was finished.
    pub why: Option<String>,
    /// How many frames the path asked for; `null` for a live walk, which has as many as there is time for.
    pub frames_due: Option<u32>,
}

/// How a walk ended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HowEnded {
    /// Its path was walked to the end.
    #[default]
    Finished,
    /// Somebody asked it to stop.
    Interrupted,
    /// A device failed.
    DeviceFailed,
    /// The shown frames could not be recorded any more, as on a full disk.
    NotRecorded,
    /// Anything else, such as a peer that broke the protocol.
    Failed,
}

impl Ended {
    /// A walk that went as it should.
    #[must_use]
    pub const fn finished(frames_due: Option<u32>) -> Self {
        Self { how: HowEnded::Finished, why: None, frames_due }
    }

    /// Whether frames are missing at the walk's end.
    #[must_use]
    pub fn early(&self) -> bool {
        self.how != HowEnded::Finished
    }

    /// One sentence without a full stop for a walk of `frames` frames that ended early; `None` for one that
    /// was finished.
    #[must_use]
    pub fn sentence(&self, frames: u32) -> Option<String> {
        if !self.early() {
            return None;
        }
        let due = self.frames_due.map_or_else(String::new, |due| format!(" of {due}"));
        let why = self.why.as_ref().map_or_else(String::new, |why| format!(": {why}"));
        Some(format!("ended early, after {frames}{due} frames{why}"))
    }
}
