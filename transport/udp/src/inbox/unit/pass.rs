//! Delivery of a unit: messages, in their order.

use trimaran_wire::{Format, FrameEnd, FrameMessage, FrameNumber, HEADER_BYTES, Kind, Message};

use super::{Step, Unit};
use crate::chunk::{CODED_UNIT, GivenUp, Tail, unit_head};
use crate::inbox::buffers::Buffers;
use crate::inbox::{LaneViolation, Received};
use crate::repair::{BLOCK, LARGEST};

/// How much delivered data is kept: an incomplete block may need it for its repair.
const RETAINED: u64 = (BLOCK * LARGEST) as u64;

impl Unit {
    /// Whether [`Unit::step`] would not wait. A full batch has `batch` bytes.
    pub(in crate::inbox) fn is_readable(&self, batch: usize, format: &Format) -> bool {
        let ready = self.ready();
        if self.given_up.is_some() || self.end.is_some_and(|(end, _)| end == self.base + ready) {
            return true;
        }
        match self.frame {
            None => self.frame_head(format).is_some_and(|head| ready >= head as u64),
            Some(_) if self.coded => !matches!(self.message_length(ready as usize, format), Ok(None)),
            Some(_) => {
                let pause = self.pause.saturating_sub(self.base).min(ready);
                ready >= batch as u64 || pause >= format.item as u64
            }
        }
    }

    pub(in crate::inbox) fn step(
        &mut self,
        batch: usize,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        let format = buffers.format;
        let ready = self.ready();
        let ended = self.end.filter(|(end, _)| *end == self.base + ready).map(|(_, tail)| tail);
        let Some(frame) = self.frame else {
            let begins = self.frame_head(&format).is_some_and(|head| ready >= head as u64);
            if self.given_up.is_some() && !begins {
                return Err(LaneViolation::Unit);
            }
            return self.first_step(ready as usize, ended, buffers);
        };
        if self.coded {
            return self.coded_step(frame, ready as usize, ended, buffers);
        }
        if let Some(about) = self.given_up {
            return self.step_over_gaps(frame, about.sent, batch, buffers);
        }
        let pause = self.pause.saturating_sub(self.base).min(ready);
        let whole = batch as u64;
        let now = if ready >= whole { whole } else { pause - pause % format.item as u64 };
        if now > 0 {
            return self.items(now as usize, buffers).map(Step::Item);
        }
        Ok(match ended {
            None => Step::Wait,
            Some(Tail::Frame(hash)) => {
                Step::Last(Some(end_of(frame, plain_items(&format, self.base), hash)?))
            }
            Some(_) => Step::Last(None),
        })
    }

    /// Delivers the next batch of a frame whose batches are messages. Behind a gap the start of the next one
    /// is unknown.
    fn coded_step(
        &mut self,
        frame: FrameNumber,
        ready: usize,
        ended: Option<Tail>,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        if let Some(length) = self.message_length(ready, &buffers.format)? {
            let message = buffers.decode(self.ahead(length))?;
            self.passed(length, buffers);
            let format = &buffers.format;
            let (items, batch) = match message {
                Message::Frame(FrameMessage::Batch(bytes)) => {
                    (bytes.len() / format.item, FrameMessage::Batch(bytes))
                }
                Message::Frame(FrameMessage::Coded(bytes)) => {
                    let count = (format.count_coded)(&bytes).ok_or(LaneViolation::Coded)?;
                    (count, FrameMessage::Coded(bytes))
                }
                _ => return Err(LaneViolation::Unit),
            };
            self.items += items as u64;
            return Ok(Step::Item(Received::Frame(batch)));
        }
        match (self.given_up, self.end, ended) {
            (Some(GivenUp { sent, hash, coded: Some(items), .. }), ..) => {
                self.base = self.base.max(sent);
                Ok(Step::Last(Some(end_of(frame, items, hash)?)))
            }
            (None, Some((end, Tail::Frame(hash))), Some(_)) if end == self.base => {
                Ok(Step::Last(Some(end_of(frame, self.items, hash)?)))
            }
            // Left by a sender that was dropped.
            (None, _, Some(Tail::End)) => Ok(Step::Last(None)),
            (None, _, None) => Ok(Step::Wait),
            _ => Err(LaneViolation::Unit),
        }
    }

    /// The length of the next batch, if all of it has come.
    fn message_length(&self, ready: usize, format: &Format) -> Result<Option<usize>, LaneViolation> {
        if ready < HEADER_BYTES {
            return Ok(None);
        }
        let mut header = [0; HEADER_BYTES];
        let came = self.store.read(self.base..self.base + HEADER_BYTES as u64).flatten();
        header.iter_mut().zip(came).for_each(|(place, byte)| *place = *byte);
        let [kind, low, middle, high] = header;
        let length = u32::from_le_bytes([low, middle, high, 0]) as usize;
        let sound = Kind::from_code(kind)
            .filter(|kind| matches!(kind, Kind::Batch | Kind::Coded))
            .is_some_and(|kind| kind.lengths(format).contains(&length));
        if !sound {
            return Err(LaneViolation::Unit);
        }
        Ok(Some(HEADER_BYTES + length).filter(|all| *all <= ready))
    }

    /// The length of the frame's beginning, if the unit is a frame.
    fn frame_head(&self, format: &Format) -> Option<usize> {
        let first = self.first_byte()?;
        let coded = first == CODED_UNIT;
        (coded || first == Kind::Begin.code()).then(|| unit_head(format, coded))
    }

    fn first_byte(&self) -> Option<u8> {
        self.store.read(0..self.ready().min(1)).flatten().next().copied()
    }

    /// The bytes from `base` on that came without a gap.
    fn ready(&self) -> u64 {
        self.store.ready().saturating_sub(self.base)
    }

    /// Delivers the items that have come, wherever they are, and then the end with their number.
    fn step_over_gaps(
        &mut self,
        frame: FrameNumber,
        sent: u64,
        batch: usize,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        let format = buffers.format;
        let (head, item, most) = (unit_head(&format, false) as u64, format.item as u64, batch as u64);
        while let Some(piece) = self.store.next_piece(self.base, most + item, &mut buffers.pool) {
            // Items lie one after the other behind the head.
            let whole = |at: u64| at.saturating_sub(head).next_multiple_of(item) + head;
            let from = whole(piece.start);
            let to = whole((piece.end + 1).saturating_sub(item));
            let count = to.saturating_sub(from).min(most);
            self.base = if count > 0 { from } else { piece.end };
            if count > 0 {
                return self.items(count as usize, buffers).map(Step::Item);
            }
        }
        self.base = self.base.max(sent);
        match self.end {
            Some((length, Tail::Frame(hash))) => {
                Ok(Step::Last(Some(end_of(frame, plain_items(&format, length), hash)?)))
            }
            _ => Err(LaneViolation::Unit),
        }
    }

    fn items(&mut self, bytes: usize, buffers: &mut Buffers) -> Result<Received, LaneViolation> {
        let batch = buffers.copy(bytes, self.ahead(bytes));
        self.passed(bytes, buffers);
        Ok(Received::Frame(FrameMessage::Batch(batch)))
    }

    /// The start of a unit tells its kind.
    fn first_step(
        &mut self,
        ready: usize,
        ended: Option<Tail>,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        let coded = self.first_byte() == Some(CODED_UNIT);
        let format = buffers.format;
        if self.given_up.is_some_and(|about| about.coded.is_some() != coded) {
            return Err(LaneViolation::Unit);
        }
        let length = match ended {
            Some(_) if ready == 0 => return Ok(Step::Last(Some(Received::Gone))),
            _ if self.frame_head(&format).is_some_and(|head| ready >= head) => unit_head(&format, false),
            Some(_) => ready,
            None => return Ok(Step::Wait),
        };
        if coded && length == unit_head(&format, false) {
            self.passed(1, buffers);
        }
        let message = buffers.decode(self.ahead(length))?;
        self.passed(length, buffers);
        match message {
            Message::Frame(FrameMessage::Begin { frame, header }) => {
                self.frame = Some(frame);
                self.coded = coded;
                Ok(Step::Item(Received::Frame(FrameMessage::Begin { frame, header })))
            }
            Message::Message(bytes) => Ok(Step::Last(Some(Received::Message(bytes)))),
            Message::Block(bytes) => Ok(Step::Last(Some(Received::Block(bytes)))),
            Message::Close(reason) => Ok(Step::Last(Some(Received::Closed(reason)))),
            _ => Err(LaneViolation::Unit),
        }
    }

    /// The next `count` bytes.
    fn ahead(&self, count: usize) -> impl Iterator<Item = &[u8]> {
        self.store.read(self.base..self.base + count as u64)
    }

    /// The next `count` bytes count as delivered.
    fn passed(&mut self, count: usize, buffers: &mut Buffers) {
        buffers.pool.work += 4 + count as u64 / 8;
        self.base += count as u64;
        self.store.release(self.base, self.base.saturating_sub(RETAINED), &mut buffers.pool);
        self.blocks.release(self.base, &mut buffers.pool);
    }
}

/// The number of items in a plain frame of so many bytes.
const fn plain_items(format: &Format, length: u64) -> u64 {
    length.saturating_sub(unit_head(format, false) as u64) / format.item as u64
}

fn end_of(frame: FrameNumber, items: u64, hash: u64) -> Result<Received, LaneViolation> {
    let items = u32::try_from(items).map_err(|_| LaneViolation::Unit)?;
    Ok(Received::Frame(FrameMessage::End(FrameEnd { frame, items, hash })))
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;

    use super::*;
    use crate::inbox::Inbox;
    use crate::inbox::tests::{all, empty, unit_of};
    use crate::samples::{FORMAT, encoded};

    /// The length of a coded frame's beginning.
    const HEAD: usize = 81;

    /// A batch of two items, and its six bytes as a message.
    fn coded() -> (FrameMessage, Vec<u8>) {
        let batch = FrameMessage::Coded(Bytes::from_static(&[2, 9]));
        (batch.clone(), encoded(&Message::Frame(batch)).to_vec())
    }

    /// Of unit 0, a coded frame, the beginning came and was taken, and then these bytes.
    fn came(rest: &[u8], tail: Tail) -> Inbox {
        let bytes = [&[CODED_UNIT][..], &unit_of(&FORMAT, rest)].concat();
        let mut inbox = empty();
        inbox.put(0, 0, Tail::More, &bytes[..HEAD]).unwrap();
        assert_eq!(all(&mut inbox).len(), 1);
        inbox.put(0, HEAD as u64, tail, rest).unwrap();
        inbox
    }

    #[test]
    fn a_coded_frame_is_readable_by_whole_batches_and_may_be_left() {
        let (batch, message) = coded();
        let mut inbox = came(&message[..4], Tail::Pause);
        assert_eq!((inbox.is_readable(), inbox.take()), (false, Ok(None)));
        inbox.put(0, HEAD as u64 + 4, Tail::More, &message[4..]).unwrap();
        assert_eq!((inbox.is_readable(), inbox.take()), (true, Ok(Some(Received::Frame(batch)))));
        assert_eq!((inbox.is_readable(), inbox.take()), (false, Ok(None)));
        inbox.put(0, HEAD as u64 + 6, Tail::End, &[]).unwrap();
        inbox.put(1, 0, Tail::More, &unit_of(&FORMAT, &[])).unwrap();
        let next = all(&mut inbox);
        assert!(matches!(next[..], [Received::Frame(FrameMessage::Begin { .. })]), "{next:?}");
    }

    #[test]
    fn a_coded_frame_holds_whole_batches_and_nothing_else() {
        let (_, message) = coded();
        for (rest, tail, batches, why) in [
            (encoded(&Message::KeepAlive).to_vec(), Tail::More, 0, "a header of four bytes says enough"),
            ([&message[..], &message[..2]].concat(), Tail::Frame(7), 1, "it ends within a header"),
            ([&message[..], &message[..5]].concat(), Tail::Frame(7), 1, "it ends within a batch"),
        ] {
            let mut inbox = came(&rest, tail);
            for _ in 0..batches {
                assert!(inbox.take().unwrap().is_some(), "{why}");
            }
            assert_eq!((inbox.is_readable(), inbox.take()), (true, Err(LaneViolation::Unit)), "{why}");
        }
    }
}
