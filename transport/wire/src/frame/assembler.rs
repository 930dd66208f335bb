//! Checks of the arriving frames lane.

use thiserror::Error;

use super::{Digest, FrameEnd, FrameOutcome};
use crate::FrameNumber;

/// A message of the frames lane.
#[derive(Debug, Clone, Copy)]
pub enum FrameStep<'b> {
    /// A frame begins.
    Begin(FrameNumber),
    /// Items of the frame that has begun.
    Batch {
        /// The number of items.
        items: usize,
        /// The items in plain encoding.
        bytes: &'b [u8],
    },
    /// The frame ends.
    End(FrameEnd),
}

/// Checks arriving frames: order, count and hash.
#[derive(Debug)]
pub struct FrameAssembler {
    most: u32,
    open: Option<Digest>,
    last: Option<FrameNumber>,
}

impl FrameAssembler {
    /// An assembler that waits for a first frame. No frame may have more than `most` items.
    #[must_use]
    pub const fn new(most: u32) -> Self {
        Self { most, open: None, last: None }
    }

    /// The frame that has begun and not ended.
    #[must_use]
    pub fn open_frame(&self) -> Option<FrameNumber> {
        self.open.as_ref().map(|digest| digest.frame)
    }

    /// Takes the next step.
    ///
    /// # Errors
    /// If it cannot come now or contradicts earlier steps. The peer cannot be trusted after that.
    pub fn take(&mut self, step: FrameStep<'_>) -> Result<Option<FrameOutcome>, FrameViolation> {
        match step {
            FrameStep::Begin(frame) => self.begin(frame).map(|()| None),
            FrameStep::Batch { items, bytes } => self.batch(items, bytes).map(|()| None),
            FrameStep::End(end) => self.end(end).map(Some),
        }
    }

    fn begin(&mut self, begun: FrameNumber) -> Result<(), FrameViolation> {
        if let Some(digest) = &self.open {
            return Err(FrameViolation::BeginInsideFrame { open: digest.frame, begun });
        }
        if let Some(last) = self.last.filter(|last| *last >= begun) {
            return Err(FrameViolation::NotRising { last, begun });
        }
        self.last = Some(begun);
        self.open = Some(Digest::new(begun));
        Ok(())
    }

    fn batch(&mut self, items: usize, bytes: &[u8]) -> Result<(), FrameViolation> {
        match &mut self.open {
            Some(digest) if digest.items + items as u64 > u64::from(self.most) => {
                Err(FrameViolation::Beyond { frame: digest.frame, most: self.most })
            }
            Some(digest) => {
                digest.add(items, bytes);
                Ok(())
            }
            None => Err(FrameViolation::ItemsOutsideFrame { count: items }),
        }
    }

    fn end(&mut self, end: FrameEnd) -> Result<FrameOutcome, FrameViolation> {
        let Some(digest) = self.open.take() else {
            return Err(FrameViolation::EndOutsideFrame { ended: end.frame });
        };
        let frame = digest.frame;
        if frame != end.frame {
            return Err(FrameViolation::EndOfOtherFrame { open: frame, ended: end.frame });
        }
        let announced = end.items;
        match u32::try_from(digest.items) {
            Ok(received) if received < announced => {
                Ok(FrameOutcome::Incomplete { frame, expected: announced, received })
            }
            Ok(received) if received == announced => {
                let received = digest.hasher.digest();
                if received == end.hash {
                    Ok(FrameOutcome::Complete(end))
                } else {
                    Err(FrameViolation::Hash { frame, announced: end.hash, received })
                }
            }
            _ => Err(FrameViolation::TooMany { frame, announced, received: digest.items }),
        }
    }
}

/// A peer breaks the order of the frames lane, or sends other items than announced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum FrameViolation {
    /// A frame began while another was open.
    #[error("{begun} began before the end of {open}")]
    BeginInsideFrame {
        /// The frame that is open.
        open: FrameNumber,
        /// The frame that began.
        begun: FrameNumber,
    },
    /// Frame numbers must rise.
    #[error("{begun} began after {last}")]
    NotRising {
        /// The frame before.
        last: FrameNumber,
        /// The frame that began.
        begun: FrameNumber,
    },
    /// Items came outside of a frame.
    #[error("{count} items came outside of a frame")]
    ItemsOutsideFrame {
        /// The number of items.
        count: usize,
    },
    /// An end came outside of a frame.
    #[error("the end of {ended} came outside of a frame")]
    EndOutsideFrame {
        /// The frame that ended.
        ended: FrameNumber,
    },
    /// Another frame ended than the one that is open.
    #[error("the end of {ended} came within {open}")]
    EndOfOtherFrame {
        /// The frame that is open.
        open: FrameNumber,
        /// The frame that ended.
        ended: FrameNumber,
    },
    /// More items came than a frame may have, and no end.
    #[error("{frame} has more than {most} items, the most that a frame may have here")]
    Beyond {
        /// The frame.
        frame: FrameNumber,
        /// The limit.
        most: u32,
    },
    /// More items came than the end announces.
    #[error("{frame} had {received} items, its end announces {announced}")]
    TooMany {
        /// The frame.
        frame: FrameNumber,
        /// The announced number.
        announced: u32,
        /// The received number.
        received: u64,
    },
    /// As many items came as announced, but not the same ones.
    #[error("the items of {frame} hash to {received:016x}, its end announces {announced:016x}")]
    Hash {
        /// The frame.
        frame: FrameNumber,
        /// The announced hash.
        announced: u64,
        /// The received hash.
        received: u64,
    },
}
