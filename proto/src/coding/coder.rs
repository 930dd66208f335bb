//! Both ends of a lane whose ids travel as changes.

use thiserror::Error;

use super::{CodedIds, CodingFault, References, Room};
use crate::{FrameEnd, FrameMessage, FrameNumber, IdBatch, Message};

/// What the layers below promise of the frames that are sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// They arrive in order, none before all of the one before it. Changes refer to the last frame.
    Ordered,
    /// They may be lost or late. Changes refer to the newest frame that was [confirmed](IdEncoder::confirm),
    /// if any.
    Lossy,
}

/// Turns the messages of a [`FrameWriter`](crate::FrameWriter) into what travels: batches of ids become
/// changes where these are shorter.
#[derive(Debug)]
pub struct IdEncoder {
    delivery: Delivery,
    confirmed: Option<FrameNumber>,
    frame: FrameNumber,
    references: References,
}

/// Turns what travels into the messages that a [`FrameAssembler`](crate::FrameAssembler) takes.
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

    /// The receiver has all of `frame`: later frames may refer to it.
    pub fn confirm(&mut self, frame: FrameNumber) {
        self.confirmed = self.confirmed.max(Some(frame));
    }

    /// What travels for the lane's next message.
    pub fn encode(&mut self, message: FrameMessage) -> Message {
        match &message {
            FrameMessage::Begin(start) => {
                self.frame = start.frame;
                self.references.begin();
            }
            FrameMessage::Ids(batch) => {
                self.references.add(batch);
                if let Some(coded) = self.changes(batch) {
                    return Message::Coded(coded);
                }
            }
            FrameMessage::End(end) => self.references.complete(end.frame),
            FrameMessage::Stats(_) => {}
        }
        Message::Frame(message)
    }

    fn changes(&mut self, batch: &IdBatch) -> Option<CodedIds> {
        let reference = match self.delivery {
            Delivery::Ordered => self.references.newest(),
            Delivery::Lossy => self.confirmed,
        };
        let back = reference.and_then(|reference| self.frame.0.checked_sub(reference.0));
        let held = reference.and_then(|reference| self.references.get(reference));
        CodedIds::shortest(batch, back.zip(held))
    }
}

impl IdDecoder {
    /// A decoder for a lane that has received no frame yet. No frame may have more than `most` ids: a few
    /// bytes of changes can stand for many.
    #[must_use]
    pub fn new(most: u32) -> Self {
        Self { most, open: None, references: References::default() }
    }

    /// Looks at a message that came plain, and passes it on.
    pub fn plain(&mut self, message: FrameMessage) -> FrameMessage {
        match &message {
            FrameMessage::Begin(start) => {
                self.open = Some(Open { frame: start.frame, ids: 0 });
                self.references.begin();
            }
            FrameMessage::Ids(batch) => self.count(batch),
            FrameMessage::End(end) => self.end(end),
            FrameMessage::Stats(_) => {}
        }
        message
    }

    /// The batch that came as changes.
    ///
    /// # Errors
    /// Outside of a frame, if they cannot be read, or if the frame would have more ids than it may.
    pub fn coded(&mut self, coded: &CodedIds) -> Result<FrameMessage, CodedViolation> {
        let Open { frame, ids } = self.open.ok_or(CodedViolation::OutsideFrame)?;
        let room = Room { ids: u64::from(self.most).saturating_sub(ids), most: self.most };
        let batch = coded
            .read(frame, &mut self.references, room)
            .map_err(|cause| CodedViolation::Fault { frame, cause })?;
        self.count(&batch);
        Ok(FrameMessage::Ids(batch))
    }

    fn count(&mut self, batch: &IdBatch) {
        if let Some(open) = &mut self.open {
            open.ids += batch.count() as u64;
            self.references.add(batch);
        }
    }

    /// A frame that lacks ids is no reference. Whether they are the right ones, the frame's hash says to who
    /// assembles it.
    fn end(&mut self, end: &FrameEnd) {
        if let Some(open) = self.open.take()
            && open.ids == u64::from(end.ids)
        {
            self.references.complete(end.frame);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BatchSize, Camera, DrawableId, FrameStart, FrameWriter};

    /// Both ends of a lane.
    struct Lane {
        writer: FrameWriter,
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
            let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 1.0, 1.0, 0.1, frame).unwrap();
            let mut sent = vec![self.writer.begin(FrameStart { frame, camera }).unwrap()];
            let ids: Vec<DrawableId> = ids.iter().copied().map(DrawableId).collect();
            self.writer.push(&ids, |message| sent.push(message)).unwrap();
            self.writer.finish(|message| sent.push(message)).unwrap();
            let mut bytes = 0;
            for (at, plain) in sent.into_iter().enumerate() {
                let message = self.encoder.encode(plain.clone());
                bytes += match &message {
                    Message::Frame(FrameMessage::Ids(batch)) => batch.as_bytes().len(),
                    Message::Coded(coded) => coded.as_bytes().len(),
                    _ => 0,
                };
                if !lost.contains(&at) {
                    let read = match message {
                        Message::Coded(coded) => self.decoder.coded(&coded)?,
                        Message::Frame(message) => self.decoder.plain(message),
                        other => unreachable!("{other:?}"),
                    };
                    assert_eq!(read, plain);
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
        lane.encoder.confirm(FrameNumber(0));
        for frame in [4, 6, 8] {
            assert!(lane.send(frame, &ids(), &[2, 5]).unwrap() <= 60);
        }
        lane.encoder.confirm(FrameNumber(2));
        let held_by_nobody = lane.send(10, &ids(), &[]).unwrap_err();
        let cause = CodingFault::UnknownReference { back: 8 };
        assert_eq!(held_by_nobody, CodedViolation::Fault { frame: FrameNumber(10), cause });
    }

    #[test]
    fn a_confirmed_frame_that_is_long_gone_is_not_referred_to() {
        let mut lane = Lane::new(Delivery::Lossy);
        let alone = lane.send(0, &ids(), &[]).unwrap();
        lane.encoder.confirm(FrameNumber(0));
        for frame in 1..8 {
            assert!(lane.send(frame, &ids(), &[]).unwrap() <= 60);
        }
        assert!(lane.send(8, &ids(), &[]).unwrap() <= 60);
        assert_eq!(lane.send(9, &ids(), &[]), Ok(alone));
    }

    #[test]
    fn changes_outside_of_a_frame_are_refused() {
        let coded = CodedIds::new(bytes::Bytes::from_static(&[0, 1, 7]));
        assert_eq!(IdDecoder::new(1).coded(&coded), Err(CodedViolation::OutsideFrame));
    }
}
