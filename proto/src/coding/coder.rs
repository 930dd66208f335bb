//! Both ends of a lane whose ids travel as changes.

use bytes::Bytes;
use thiserror::Error;
use trimaran_wire::{BatchDecoder, BatchEncoder, CodingError, Delivery, FrameEnd};

use super::{CodingFault, References, Room, read, shortest};
use crate::{DrawableId, FrameNumber, IdBatch};

/// Writes batches of ids as changes where these are shorter. The reference is the last frame where frames
/// arrive in order, otherwise the newest confirmed one, if any.
#[derive(Debug)]
pub struct IdEncoder {
    delivery: Delivery,
    confirmed: Option<FrameNumber>,
    frame: FrameNumber,
    references: References,
}

/// Reads what an [`IdEncoder`] wrote.
#[derive(Debug)]
pub struct IdDecoder {
    most: u32,
    open: Option<Open>,
    references: References,
}

/// The current frame.
#[derive(Debug, Clone, Copy)]
struct Open {
    frame: FrameNumber,
    ids: u64,
}

/// Invalid changes from a peer. It cannot be trusted after that.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CodedViolation {
    /// They came outside of a frame.
    #[error("ids as changes came outside of a frame")]
    OutsideFrame,
    /// They cannot be read.
    #[error("ids of {frame} came as changes that cannot be read")]
    Fault {
        /// The frame that is open.
        frame: FrameNumber,
        /// The fault.
        #[source]
        cause: CodingFault,
    },
}

impl IdEncoder {
    /// An encoder for a lane that has sent no frame yet.
    #[must_use]
    pub fn new(delivery: Delivery) -> Self {
        Self { delivery, confirmed: None, frame: FrameNumber(0), references: References::default() }
    }

    fn changes(&mut self, batch: &IdBatch) -> Option<Bytes> {
        let reference = match self.delivery {
            Delivery::Ordered => self.references.newest(),
            Delivery::Lossy => self.confirmed,
        };
        let back = reference.and_then(|reference| self.frame.0.checked_sub(reference.0));
        let held = reference.and_then(|reference| self.references.get(reference));
        shortest(batch, back.zip(held))
    }
}

impl IdDecoder {
    /// A decoder for a lane that has received no frame yet. A frame of more than `most` ids is refused,
    /// because a few bytes of changes can stand for many.
    #[must_use]
    pub fn new(most: u32) -> Self {
        Self { most, open: None, references: References::default() }
    }

    /// Decodes a batch of changes.
    ///
    /// # Errors
    /// Outside of a frame, if they cannot be read, or if the frame would exceed its limit of ids.
    pub fn read(&mut self, bytes: &[u8]) -> Result<IdBatch, CodedViolation> {
        let Open { frame, ids } = self.open.ok_or(CodedViolation::OutsideFrame)?;
        let room = Room { ids: u64::from(self.most).saturating_sub(ids), most: self.most };
        let batch = read(bytes, frame, &mut self.references, room)
            .map_err(|cause| CodedViolation::Fault { frame, cause })?;
        self.count(&batch);
        Ok(batch)
    }

    fn count(&mut self, batch: &IdBatch) {
        if let Some(open) = &mut self.open {
            open.ids += batch.count() as u64;
            self.references.add(batch);
        }
    }
}

impl BatchEncoder<DrawableId> for IdEncoder {
    fn begin(&mut self, frame: FrameNumber) {
        self.frame = frame;
        self.references.begin();
    }

    fn encode(&mut self, batch: &IdBatch) -> Option<Bytes> {
        self.references.add(batch);
        self.changes(batch)
    }

    fn end(&mut self, end: &FrameEnd) {
        self.references.complete(end.frame);
    }

    fn confirmed(&mut self, frame: FrameNumber) {
        self.confirmed = self.confirmed.max(Some(frame));
    }
}

impl BatchDecoder<DrawableId> for IdDecoder {
    fn begin(&mut self, frame: FrameNumber) {
        self.open = Some(Open { frame, ids: 0 });
        self.references.begin();
    }

    fn plain(&mut self, batch: &IdBatch) {
        self.count(batch);
    }

    fn decode(&mut self, bytes: &[u8]) -> Result<IdBatch, CodingError> {
        self.read(bytes).map_err(|e| CodingError(e.into()))
    }

    /// A frame with missing ids is no reference. The frame's hash shows the assembler whether the ids are
    /// right.
    fn end(&mut self, end: &FrameEnd) {
        if let Some(open) = self.open.take()
            && open.ids == u64::from(end.items)
        {
            self.references.complete(end.frame);
        }
    }
}
