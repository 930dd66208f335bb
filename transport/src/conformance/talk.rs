//! The values and messages of the suite's peers.

use std::time::Duration;

use bytes::Bytes;
use trimaran_wire::{BatchSize, CloseReason, FrameEnd, FrameNumber, FrameOutcome, MAX_BLOCK};

use super::robot::{Command, Greeting, Pose, Robot};
use crate::{FrameEvent, FrameReceiver, FrameSender, FrameStart, LinkConfig, RecvError, SendError};

/// The role of a robot: it listens, sends frames of points, and receives poses.
pub const ARM: &str = "arm";
/// The role of another robot.
pub const GRIPPER: &str = "gripper";
/// The role of a person's panel: it connects, publishes poses, and receives points.
pub const PANEL: &str = "panel";
/// The map of all peers that fit together.
pub const MAP: u64 = 0x5ce7e;

/// The hello of the peer in this role.
#[must_use]
pub fn greeting(role: &str) -> Greeting {
    Greeting { name: role.to_owned(), role: Some(role.to_owned()), map: MAP, batch: None }
}

/// A pose of this number.
#[must_use]
pub fn pose(number: u32) -> Pose {
    Pose { number, position: [f64::from(number), 2.0, -3.5], heading: 0.5 }
}

/// A command of this number: some are long.
#[must_use]
pub fn command(number: u32) -> Command {
    let length = if number % 50 == 10 { 16_000 } else { number as usize % 100 };
    Command { number, program: "go ".chars().cycle().take(length).collect() }
}

/// A block of this number: some have the largest size, some are empty.
#[must_use]
pub fn block(number: u32) -> Bytes {
    let length = if number % 50 == 10 { MAX_BLOCK } else { number as usize % 100 };
    number.to_le_bytes().into_iter().cycle().take(length).collect()
}

/// The start of a frame of this number.
#[must_use]
pub fn start(frame: u32) -> FrameStart<Pose> {
    FrameStart { frame: FrameNumber(frame), header: pose(frame + 100) }
}

/// So many points, in no order.
#[must_use]
pub fn points(count: u32) -> Vec<u32> {
    (0..count).map(|n| (n ^ (n >> 3)).wrapping_mul(2_654_435_761)).collect()
}

/// The reason of a peer that has finished.
#[must_use]
pub fn finished() -> CloseReason {
    CloseReason::new(0, "all is done")
}

/// Sends a frame of this number with these points.
///
/// # Errors
/// Those of [`FrameSender`].
pub async fn send_frame(
    tx: &mut FrameSender<Robot>,
    frame: u32,
    points: &[u32],
) -> Result<FrameEnd, SendError> {
    tx.begin(start(frame)).await?;
    tx.push(points).await?;
    tx.finish().await
}

/// One frame as it was received.
#[derive(Debug)]
pub struct Received {
    /// Its start.
    pub start: FrameStart<Pose>,
    /// The number of points in each batch.
    pub batches: Vec<usize>,
    /// All points.
    pub points: Vec<u32>,
    /// Its end.
    pub end: FrameEnd,
}

/// Reads one frame that must be complete.
///
/// # Errors
/// Those of [`FrameReceiver::recv`].
///
/// # Panics
/// If the frame is not complete.
pub async fn receive(rx: &mut FrameReceiver<Robot>) -> Result<Received, RecvError> {
    let first = rx.recv().await?;
    let FrameEvent::Begin(start) = first else { panic!("{first:?} before a frame") };
    let (mut batches, mut points) = (Vec::new(), Vec::new());
    loop {
        match rx.recv().await? {
            FrameEvent::Batch(batch) => {
                batches.push(batch.count());
                points.extend(batch.iter());
            }
            FrameEvent::End(FrameOutcome::Complete(end)) => {
                return Ok(Received { start, batches, points, end });
            }
            other => panic!("{other:?} within a frame"),
        }
    }
}

/// A configuration whose timeouts are long enough for a busy machine.
pub(super) fn patient() -> LinkConfig {
    LinkConfig { timeout: Duration::from_secs(60), ..LinkConfig::default() }
}

/// The same, with batches of so many points.
pub(super) fn batches_of(points: u32) -> LinkConfig {
    let mut config = patient();
    config.batching.size = BatchSize::new(points).unwrap();
    config
}

/// The same, and they travel coded.
pub(super) fn coded(points: u32) -> LinkConfig {
    let mut config = batches_of(points);
    config.batching.coded = true;
    config
}

/// Of 4,000 points, others are hidden in each frame.
pub(super) fn visible(frame: u32) -> Vec<u32> {
    (0..4000).filter(|n| !(n + 3 * frame).is_multiple_of(100)).map(|n| 5 * n).collect()
}
