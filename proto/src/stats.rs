//! A culler's statistics of its own work on a frame.

use std::ops::{Add, Sub};

use serde::{Deserialize, Serialize};

use crate::FrameNumber;

/// A culler's work on a frame: OR, then HC. It follows the frame's end and is for reports; nothing waits for
/// it.
///
/// Times are nanoseconds on the sender's own clock. [`FrameStats::hc_start_ns`] is when it sent the frame's
/// begin. A receiver that notes the begin's arrival can place the others on its own clock, late by the link's
/// one-way delay. Where roles of one process take turns, HC's work counts as one piece that ends at
/// [`FrameStats::hc_end_ns`], even if other roles computed in between.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct FrameStats {
    /// The frame, as the display numbers it.
    pub frame: FrameNumber,
    /// The frame whose visible set OR drew from, if there was an earlier one.
    pub occluders_of: Option<FrameNumber>,
    /// When OR began: the camera and at least the first occluders were there.
    pub or_start_ns: u64,
    /// When OR was complete.
    pub or_end_ns: u64,
    /// Of that, the time OR worked and did not wait for ids. At its end the depth is ready for tests.
    pub or_busy_ns: u64,
    /// When HC began.
    pub hc_start_ns: u64,
    /// When HC was complete.
    pub hc_end_ns: u64,
    /// The device's part of this work.
    pub device: DeviceTimes,
    /// Drawables drawn as occluders, by OR and in further rounds of HC.
    pub occluders: u32,
    /// Their triangles.
    pub occluder_triangles: u64,
    /// HC's work in all rounds.
    pub culling: CullCounts,
    /// The part of further rounds in it.
    pub rounds: RoundCounts,
    /// Bytes sent to the other culler for the frame (the schedule `switch`). The display counts its own.
    pub to_other: SentBytes,
}

/// The device's times for a frame's passes, nanoseconds by its own timestamps. 0 where the host did the work,
/// or the device has no timestamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct DeviceTimes {
    /// Drawing: of occluders, in all rounds.
    pub drawing_ns: u64,
    /// Building the depth pyramid.
    pub pyramid_ns: u64,
    /// Traversing the tree, for occluders and for visible nodes, or testing boxes.
    pub culling_ns: u64,
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
    /// Geometry for a display without the scene, and that display's messages about it.
    pub geometry: u64,
    /// Headers.
    pub headers: u64,
    /// The number of messages, not bytes.
    pub messages: u64,
}

impl Add for DeviceTimes {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            drawing_ns: self.drawing_ns.saturating_add(other.drawing_ns),
            pyramid_ns: self.pyramid_ns.saturating_add(other.pyramid_ns),
            culling_ns: self.culling_ns.saturating_add(other.culling_ns),
        }
    }
}

impl FrameStats {
    /// Of a frame whose set another session has culled: no work at `now_ns`.
    #[must_use]
    pub fn of_no_work(frame: FrameNumber, now_ns: u64) -> Self {
        Self {
            frame,
            or_start_ns: now_ns,
            or_end_ns: now_ns,
            hc_start_ns: now_ns,
            hc_end_ns: now_ns,
            ..Self::default()
        }
    }
}

impl SentBytes {
    /// All bytes.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.camera + self.begin + self.ids + self.end + self.control + self.geometry + self.headers
    }

    /// Each number of both, joined.
    fn zip(self, other: Self, join: fn(u64, u64) -> u64) -> Self {
        Self {
            camera: join(self.camera, other.camera),
            begin: join(self.begin, other.begin),
            ids: join(self.ids, other.ids),
            end: join(self.end, other.end),
            control: join(self.control, other.control),
            geometry: join(self.geometry, other.geometry),
            headers: join(self.headers, other.headers),
            messages: join(self.messages, other.messages),
        }
    }
}

impl Add for SentBytes {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        self.zip(other, u64::add)
    }
}

impl Sub for SentBytes {
    type Output = Self;

    /// The bytes sent since `earlier`.
    fn sub(self, earlier: Self) -> Self {
        self.zip(earlier, u64::sub)
    }
}

/// HC's tree traversal in numbers. Each visited node is counted once among `outside`, `hidden`, `emitted` and
/// `refined`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CullCounts {
    /// Nodes visited.
    pub visited: u32,
    /// Nodes outside the frustum.
    pub outside: u32,
    /// Boxes tested.
    pub tested: u32,
    /// Boxes found hidden.
    pub hidden: u32,
    /// Visible without a test: a corner is nearer than the near plane.
    pub near_visible: u32,
    /// Visible without a test: the eye is in the inflated box.
    pub eye_inside: u32,
    /// Visible without a test: a coordinate is not a finite f32.
    pub not_finite: u32,
    /// Drawn too coarsely because they cover few pixels
    /// ([`LodRule::stopping_at_few_pixels`](crate::LodRule::stopping_at_few_pixels)).
    pub few_pixels: u32,
    /// Drawables sent.
    pub emitted: u32,
    /// Visible nodes that were too coarse.
    pub refined: u32,
    /// Batches of occlusion tests.
    pub batches: u32,
}

/// HC's work in further rounds. After the first traversal it draws more occluders, and tests its results
/// again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RoundCounts {
    /// Further rounds: 0 in most frames.
    pub further: u32,
    /// Triangles of the occluders that were drawn in them.
    pub occluder_triangles: u64,
    /// The time spent drawing them.
    pub drawing_ns: u64,
    /// Boxes tested again.
    pub tested: u32,
    /// Drawables found hidden.
    pub hidden: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each number is a power of ten of its own, times `digit`.
    fn sent(digit: u64) -> SentBytes {
        SentBytes {
            camera: digit,
            begin: 10 * digit,
            ids: 100 * digit,
            end: 1_000 * digit,
            control: 10_000 * digit,
            geometry: 100_000 * digit,
            headers: 1_000_000 * digit,
            messages: 10_000_000 * digit,
        }
    }

    #[test]
    fn bytes_are_summed_kind_by_kind_and_in_all() {
        assert_eq!(sent(1).total(), 1_111_111, "messages are no bytes");
        assert_eq!((sent(3) + sent(2), sent(3) - sent(2)), (sent(5), sent(1)));
    }

    #[test]
    fn times_of_the_device_are_summed_up_to_the_largest_number() {
        let times = DeviceTimes { drawing_ns: 1, pyramid_ns: 2, culling_ns: u64::MAX };
        let twice = DeviceTimes { drawing_ns: 2, pyramid_ns: 4, culling_ns: u64::MAX };
        assert_eq!(times + times, twice);
    }

    #[test]
    fn no_work_begins_and_ends_at_once() {
        let stats = FrameStats::of_no_work(FrameNumber(4), 9);
        let times =
            [stats.or_start_ns, stats.or_end_ns, stats.hc_start_ns, stats.hc_end_ns, stats.or_busy_ns];
        assert_eq!((stats.frame, times), (FrameNumber(4), [9, 9, 9, 9, 0]));
    }
}
