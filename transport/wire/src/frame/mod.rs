//! Frames of items: written and checked.

mod assembler;
mod writer;

use std::fmt;

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

pub use assembler::{FrameAssembler, FrameStep, FrameViolation};
pub use writer::{FrameOrderError, FrameWriter};

use crate::FixedBytes;

/// The number of a frame, counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[repr(transparent)]
pub struct FrameNumber(pub u32);

impl FrameNumber {
    /// The frame after this one; `None` after frame `u32::MAX` (828 days at 60 frames a second).
    #[must_use]
    pub const fn next(self) -> Option<Self> {
        match self.0.checked_add(1) {
            Some(n) => Some(Self(n)),
            None => None,
        }
    }
}

impl fmt::Display for FrameNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "frame {}", self.0)
    }
}

/// The end of a frame: its number of items and their hash.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameEnd {
    /// The frame that ends.
    pub frame: FrameNumber,
    /// Its number of items.
    pub items: u32,
    /// XXH3-64 (seed 0) of the items in order, in plain encoding.
    pub hash: u64,
}

/// The messages of the frames lane.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FrameMessage {
    /// A frame begins.
    Begin {
        /// Its number.
        frame: FrameNumber,
        /// The application's header.
        header: FixedBytes,
    },
    /// Whole items of the frame that has begun, plain.
    Batch(Bytes),
    /// Items of the frame that has begun, in the application's own shorter form.
    Coded(Bytes),
    /// The frame ends.
    End(FrameEnd),
}

/// The outcome of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameOutcome {
    /// Every item arrived, in order.
    Complete(FrameEnd),
    /// Some items are missing.
    Incomplete {
        /// The frame.
        frame: FrameNumber,
        /// The number of items sent.
        expected: u32,
        /// The number that arrived.
        received: u32,
    },
}

/// Counts and hashes the items of one frame.
struct Digest {
    frame: FrameNumber,
    items: u64,
    hasher: Xxh3,
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} with {} items", self.frame, self.items)
    }
}

impl Digest {
    fn new(frame: FrameNumber) -> Self {
        Self { frame, items: 0, hasher: Xxh3::new() }
    }

    fn add(&mut self, items: usize, bytes: &[u8]) {
        self.items += items as u64;
        self.hasher.update(bytes);
    }
}
