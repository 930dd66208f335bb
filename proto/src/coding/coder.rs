//! Both ends of a lane whose ids travel as changes.

use bytes::Bytes;
use thiserror::Error;
use trimaran_wire::{BatchDecoder, BatchEncoder, CodingError, Delivery, FrameEnd};

use super::{CodingFault, References, Room, read, shortest};
use crate::{DrawableId, FrameNumber, IdBatch};

/// Writes batches of ids as changes where these are shorter: against the last frame where frames arrive in
/// order, else against the newest that was confirmed, if any.
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

/// The frame under way.
#[derive(Debug, Clone, Copy)]
struct Open {
    frame: FrameNumber,
    ids: u64,
}

/// A peer whose changes make no sense. It cannot be trusted after that.
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
        /// What is wrong with them.
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
    /// A decoder for a lane that has received no frame yet. No frame may have more than `most` ids: a few
    /// bytes of changes can stand for many.
    #[must_use]
    pub fn new(most: u32) -> Self {
        Self { most, open: None, references: References::default() }
    }

    /// The batch that came as changes.
    ///
    /// # Errors
    /// Outside of a frame, if they cannot be read, or if the frame would have more ids than it may.
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

    /// A frame that lacks ids is no reference. Whether they are the right ones, the frame's hash says to who
    /// assembles it.
    fn end(&mut self, end: &FrameEnd) {
        if let Some(open) = self.open.take()
            && open.ids == u64::from(end.items)
        {
            self.references.complete(end.frame);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trimaran_wire::{BatchSize, FrameMessage, FrameWriter};

    /// Both ends of a lane.
    struct Lane {
        writer: FrameWriter<DrawableId>,
        encoder: IdEncoder,
        decoder: IdDecoder,
    }

    impl Lane {
        fn new(delivery: Delivery) -> Self {
            Self {
                writer: FrameWriter::new(BatchSize::new(100).unwrap()),
                encoder: IdEncoder::new(delivery),
                decoder: IdDecoder::new(u32::MAX),
            }
        }

        /// Sends a frame, but for the messages at `lost`; what arrives must be what was sent. Gives the bytes
        /// of its ids.
        fn send(&mut self, frame: u32, ids: &[u32], lost: &[usize]) -> Result<usize, CodedViolation> {
            let frame = FrameNumber(frame);
            let mut sent = Vec::new();
            self.writer.begin(frame).unwrap();
            let ids: Vec<DrawableId> = ids.iter().copied().map(DrawableId).collect();
            self.writer.push(&ids, |message| sent.push(message)).unwrap();
            self.writer.finish(|message| sent.push(message)).unwrap();
            self.encoder.begin(frame);
            if !lost.contains(&0) {
                self.decoder.begin(frame);
            }
            let mut bytes = 0;
            for (at, message) in (1..).zip(sent) {
                match message {
                    FrameMessage::Batch(plain) => {
                        let plain = IdBatch::new(plain).unwrap();
                        let coded = self.encoder.encode(&plain);
                        bytes += coded.as_ref().map_or(plain.as_bytes().len(), Bytes::len);
                        if !lost.contains(&at) {
                            match coded {
                                Some(coded) => assert_eq!(self.decoder.read(&coded)?, plain),
                                None => self.decoder.plain(&plain),
                            }
                        }
                    }
                    FrameMessage::End(end) => {
                        self.encoder.end(&end);
                        if !lost.contains(&at) {
                            self.decoder.end(&end);
                        }
                    }
                    other => unreachable!("{other:?}"),
                }
            }
            Ok(bytes)
        }
    }

    fn ids() -> Vec<u32> {
        (0..1000).map(|i| 1000 * i).collect()
    }

    #[test]
    fn frames_in_order_refer_to_the_last_one() {
        let mut lane = Lane::new(Delivery::Ordered);
        let first = lane.send(0, &ids(), &[]).unwrap();
        assert!((2000..2050).contains(&first), "each by a gap of two bytes: {first}");
        let second = lane.send(2, &ids(), &[]).unwrap();
        assert!(second <= 10 * 6, "{second} bytes for ten batches without a change");
        let other: Vec<u32> = ids().iter().map(|id| id + 500).collect();
        let alone = lane.send(4, &other, &[]).unwrap();
        assert!((2000..2050).contains(&alone), "by themselves again: {alone}");
        assert_eq!(lane.send(6, &[], &[]), Ok(0));
        let after_nothing = lane.send(8, &other, &[]).unwrap();
        assert!((2000..2050).contains(&after_nothing), "nothing is left to refer to: {after_nothing}");
    }

    #[test]
    fn after_a_lost_frame_only_what_was_confirmed_is_referred_to() {
        let mut lane = Lane::new(Delivery::Lossy);
        let alone = lane.send(0, &ids(), &[]).unwrap();
        assert_eq!(lane.send(2, &ids(), &[3]), Ok(alone), "nothing is confirmed");
        lane.encoder.confirmed(FrameNumber(0));
        for frame in [4, 6, 8] {
            assert!(lane.send(frame, &ids(), &[2, 5]).unwrap() <= 60);
        }
        lane.encoder.confirmed(FrameNumber(2));
        let held_by_nobody = lane.send(10, &ids(), &[]).unwrap_err();
        let cause = CodingFault::UnknownReference { back: 8 };
        assert_eq!(held_by_nobody, CodedViolation::Fault { frame: FrameNumber(10), cause });
    }

    #[test]
    fn a_confirmed_frame_that_is_long_gone_is_not_referred_to() {
        let mut lane = Lane::new(Delivery::Lossy);
        let alone = lane.send(0, &ids(), &[]).unwrap();
        lane.encoder.confirmed(FrameNumber(0));
        for frame in 1..8 {
            assert!(lane.send(frame, &ids(), &[]).unwrap() <= 60);
        }
        assert!(lane.send(8, &ids(), &[]).unwrap() <= 60);
        assert_eq!(lane.send(9, &ids(), &[]), Ok(alone));
    }

    #[test]
    fn changes_outside_of_a_frame_are_refused() {
        assert_eq!(IdDecoder::new(1).read(&[0, 1, 7]), Err(CodedViolation::OutsideFrame));
    }
}
