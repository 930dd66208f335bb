//! A frame of ids: written, checked, judged.

mod assembler;
mod writer;

use xxhash_rust::xxh3::Xxh3;

pub use assembler::{FrameAssembler, FrameViolation};
pub use writer::{FrameOrderError, FrameWriter};

use crate::{Camera, FrameNumber, FrameStats, IdBatch};

/// How a frame begins: its number, and the camera that its ids were culled for.
///
/// The camera's own frame number is the one that the display gave it; in live mode that may be another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameStart {
    /// The frame that the ids are for.
    pub frame: FrameNumber,
    /// The camera that it was culled for.
    pub camera: Camera,
}

/// How a frame ends: what must have arrived by then.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameEnd {
    /// The frame that ends.
    pub frame: FrameNumber,
    /// How many ids it had.
    pub ids: u32,
    /// XXH3-64 (seed 0) of the ids in order, as they travel.
    pub hash: u64,
}

/// The messages of the frames lane.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameMessage {
    /// A frame begins.
    Begin(FrameStart),
    /// Ids of the frame that has begun.
    Ids(IdBatch),
    /// The frame ends.
    End(FrameEnd),
    /// What the sender did for a frame that has ended.
    Stats(FrameStats),
}

/// What a receiver of frames learns.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameEvent {
    /// A frame begins.
    Begin(FrameStart),
    /// Ids of the frame that has begun, in the order in which they were pushed.
    Ids(IdBatch),
    /// The frame is over.
    End(FrameOutcome),
    /// What the sender did for a frame that is over; between frames.
    Stats(FrameStats),
}

/// What became of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameOutcome {
    /// Every id arrived, in order.
    Complete(FrameEnd),
    /// Some ids are missing: what they named counts as visible until the next frame.
    Incomplete {
        /// The frame.
        frame: FrameNumber,
        /// How many ids were sent.
        expected: u32,
        /// How many arrived.
        received: u32,
    },
}

/// Counts and hashes the ids of one frame.
struct Digest {
    frame: FrameNumber,
    ids: u64,
    hasher: Xxh3,
}

impl Digest {
    fn new(frame: FrameNumber) -> Self {
        Self { frame, ids: 0, hasher: Xxh3::new() }
    }

    fn add(&mut self, batch: &IdBatch) {
        self.ids += batch.count() as u64;
        self.hasher.update(batch.as_bytes());
    }
}
