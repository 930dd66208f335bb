//! Frames as their receiver is told of them.

use crate::{Batch, FrameNumber, FrameOutcome, Protocol};

/// The start of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameStart<H> {
    /// The frame's number: it rises from frame to frame.
    pub frame: FrameNumber,
    /// The application's header.
    pub header: H,
}

impl<H> FrameStart<H> {
    /// The start of the frame of this number.
    #[must_use]
    pub const fn new(number: u32, header: H) -> Self {
        Self { frame: FrameNumber(number), header }
    }
}

/// An event for a receiver of frames.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameEvent<P: Protocol> {
    /// A frame begins.
    Begin(FrameStart<P::Header>),
    /// Items of the frame that has begun, in the order in which they were pushed.
    Batch(Batch<P::Item>),
    /// The frame is over.
    End(FrameOutcome),
}
