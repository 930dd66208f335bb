//! What a culler says of its own work on a frame.

use std::ops::{Add, Sub};

use serde::{Deserialize, Serialize};

use crate::FrameNumber;

/// What a culler did for a frame: OR, then HC. It follows the frame's end, for reports;
/// nothing waits for it.
///
/// Times are nanoseconds on the sender's own clock. [`FrameStats::hc_start_ns`] is when it sent the frame's
/// begin: a receiver that notes when that came can place the others on its own clock, late by the link's
/// one-way delay. Where roles of one process take turns and others computed in the midst of HC, its work
/// counts as one piece that ends at [`FrameStats::hc_end_ns`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct FrameStats {
    /// The frame, as the display numbers it.
    pub frame: FrameNumber,
    /// The frame whose visible set OR drew from, if there was one before.
    pub occluders_of: Option<FrameNumber>,
    /// When OR began: the camera was there, and the occluders or the first of them.
    pub or_start_ns: u64,
    /// When OR was complete.
    pub or_end_ns: u64,
    /// Of that, the time in which it worked and did not wait for ids: the depth is drawn, and ready to be
    /// tested against.
    pub or_busy_ns: u64,
    /// When HC began.
    pub hc_start_ns: u64,
    /// When HC was complete.
    pub hc_end_ns: u64,
    /// Drawables drawn as occluders, by OR and in further rounds of HC.
    pub occluders: u32,
    /// Their triangles.
    pub occluder_triangles: u64,
    /// What HC did, in all rounds.
    pub culling: CullCounts,
    /// What further rounds were part of it.
    pub rounds: RoundCounts,
    /// What it sent to another culler for the frame (the schedule `switch`); what the display got, the
    /// display counts itself.
    pub to_other: SentBytes,
}

/// Bytes sent over one link, by kind: payloads, and the headers of all messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SentBytes {
    /// Cameras.
    pub camera: u64,
    /// Beginnings of frames.
    pub begin: u64,
    /// Ids.
    pub ids: u64,
    /// Ends of frames; `eof` in reports.
    #[serde(rename = "eof")]
    pub end: u64,
    /// Statistics and other control messages.
    pub control: u64,
    /// Geometry for a display without the scene, and what that says of it.
    pub geometry: u64,
    /// Headers.
    pub headers: u64,
    /// The number of messages, not bytes.
    pub messages: u64,
}

impl SentBytes {
    /// All bytes.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.camera + self.begin + self.ids + self.end + self.control + self.geometry + self.headers
    }
}

impl Add for SentBytes {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            camera: self.camera + other.camera,
            begin: self.begin + other.begin,
            ids: self.ids + other.ids,
            end: self.end + other.end,
            control: self.control + other.control,
            geometry: self.geometry + other.geometry,
            headers: self.headers + other.headers,
            messages: self.messages + other.messages,
        }
    }
}

impl Sub for SentBytes {
    type Output = Self;

    /// What was sent since `earlier`.
    fn sub(self, earlier: Self) -> Self {
        Self {
            camera: self.camera - earlier.camera,
            begin: self.begin - earlier.begin,
            ids: self.ids - earlier.ids,
            end: self.end - earlier.end,
            control: self.control - earlier.control,
            geometry: self.geometry - earlier.geometry,
            headers: self.headers - earlier.headers,
            messages: self.messages - earlier.messages,
        }
    }
}

/// What HC's walk down the tree did. Each node it came to is counted once among `outside`, `hidden`,
/// `emitted` and `refined`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CullCounts {
    /// Nodes it came to.
    pub visited: u32,
    /// Nodes outside the frustum.
    pub outside: u32,
    /// Boxes tested.
    pub tested: u32,
    /// Boxes found hidden.
    pub hidden: u32,
    /// Visible untested: a corner is nearer than the near plane.
    pub near_visible: u32,
    /// Visible untested: the eye is in the inflated box.
    pub eye_inside: u32,
    /// Visible untested: a coordinate is not a finite f32.
    pub not_finite: u32,
    /// Drawn too coarsely because they show at few pixels
    /// ([`LodRule::stopping_at_few_pixels`](crate::LodRule::stopping_at_few_pixels)).
    pub few_pixels: u32,
    /// Drawables sent.
    pub emitted: u32,
    /// Visible nodes that were too coarse.
    pub refined: u32,
    /// Batches of box tests.
    pub batches: u32,
}

/// What HC did in further rounds: after the first traversal it draws more occluders, and tests again what it
/// found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RoundCounts {
    /// Further rounds: 0 in most frames.
    pub further: u32,
    /// Triangles of the occluders that were drawn in them.
    pub occluder_triangles: u64,
    /// The time in which these were drawn.
    pub drawing_ns: u64,
    /// Boxes tested again.
    pub tested: u32,
    /// Drawables found hidden.
    pub hidden: u32,
}
