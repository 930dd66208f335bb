//! What of a unit is passed on: messages, in their order.

use trimaran_proto::{
    BatchSize, FrameEnd, FrameMessage, FrameNumber, HEADER_BYTES, ID_BYTES, IdBatch, Kind, Message,
};

use super::{Step, Unit};
use crate::chunk::{CODED_UNIT, GivenUp, Tail, unit_head};
use crate::inbox::buffers::Buffers;
use crate::inbox::{LaneViolation, Received};
use crate::repair::{BLOCK, LARGEST};

/// How much of what was passed on is kept: a block that is not whole yet may need it for its repair.
const RETAINED: u64 = (BLOCK * LARGEST) as u64;

impl Unit {
    /// Whether [`Unit::step`] would not wait.
    pub(in crate::inbox) fn is_readable(&self, batch: BatchSize) -> bool {
        let ready = self.ready();
        if self.given_up.is_some() || self.end.is_some_and(|(end, _)| end == self.base + ready) {
            return true;
        }
        match self.frame {
            None => ready >= unit_head(self.first_byte() == Some(CODED_UNIT)) as u64,
            Some(_) if self.coded => !matches!(self.message_length(ready as usize), Ok(None)),
            Some(_) => {
                let pause = self.pause.saturating_sub(self.base).min(ready);
                ready >= batch.bytes() as u64 || pause >= ID_BYTES as u64
            }
        }
    }

    pub(in crate::inbox) fn step(
        &mut self,
        batch: BatchSize,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        let ready = self.ready();
        let ended = self.end.filter(|(end, _)| *end == self.base + ready).map(|(_, tail)| tail);
        let Some(frame) = self.frame else {
            if self.given_up.is_some_and(|about| ready < unit_head(about.coded.is_some()) as u64) {
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
        let whole = batch.bytes() as u64;
        let now = if ready >= whole { whole } else { pause - pause % ID_BYTES as u64 };
        if now > 0 {
            return self.ids(now as usize, buffers).map(Step::Item);
        }
        Ok(match ended {
            None => Step::Wait,
            Some(Tail::Frame(hash)) => Step::Last(Some(end_of(frame, plain_ids(self.base), hash)?)),
            Some(_) => Step::Last(None),
        })
    }

    /// Passes on the next batch of a frame whose batches are messages. Behind a gap nobody knows where the
    /// next one begins.
    fn coded_step(
        &mut self,
        frame: FrameNumber,
        ready: usize,
        ended: Option<Tail>,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        if let Some(length) = self.message_length(ready)? {
            let message = buffers.decode(self.ahead(length))?;
            self.passed(length, buffers);
            let (ids, batch) = match message {
                Message::Frame(FrameMessage::Ids(batch)) => {
                    (batch.count(), Received::Frame(FrameMessage::Ids(batch)))
                }
                Message::Coded(batch) => (batch.count()?, Received::Coded(batch)),
                _ => return Err(LaneViolation::Unit),
            };
            self.ids += ids as u64;
            return Ok(Step::Item(batch));
        }
        match (self.given_up, self.end, ended) {
            (Some(GivenUp { sent, hash, coded: Some(ids), .. }), ..) => {
                self.base = self.base.max(sent);
                Ok(Step::Last(Some(end_of(frame, ids, hash)?)))
            }
            (None, Some((end, Tail::Frame(hash))), Some(_)) if end == self.base => {
                Ok(Step::Last(Some(end_of(frame, self.ids, hash)?)))
            }
            // Left by a sender that was dropped.
            (None, _, Some(Tail::End)) => Ok(Step::Last(None)),
            (None, _, None) => Ok(Step::Wait),
            _ => Err(LaneViolation::Unit),
        }
    }

    /// How long the batch is that comes next, if all of it is there.
    fn message_length(&self, ready: usize) -> Result<Option<usize>, LaneViolation> {
        if ready < HEADER_BYTES {
            return Ok(None);
        }
        let mut header = [0; HEADER_BYTES];
        let came = self.store.read(self.base..self.base + HEADER_BYTES as u64).flatten();
        header.iter_mut().zip(came).for_each(|(place, byte)| *place = *byte);
        let [kind, low, middle, high] = header;
        let length = u32::from_le_bytes([low, middle, high, 0]) as usize;
        let sound = Kind::from_code(kind)
            .filter(|kind| matches!(kind, Kind::Ids | Kind::Coded))
            .is_some_and(|kind| kind.lengths().contains(&length));
        if !sound {
            return Err(LaneViolation::Unit);
        }
        Ok(Some(HEADER_BYTES + length).filter(|all| *all <= ready))
    }

    fn first_byte(&self) -> Option<u8> {
        self.store.read(0..self.ready().min(1)).flatten().next().copied()
    }

    /// How many bytes from `base` on have come without a gap.
    fn ready(&self) -> u64 {
        self.store.ready().saturating_sub(self.base)
    }

    /// Passes on the ids that have come, wherever they are, and then the end that says how many there were.
    fn step_over_gaps(
        &mut self,
        frame: FrameNumber,
        sent: u64,
        batch: BatchSize,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        let id = ID_BYTES as u64;
        while let Some(piece) = self.store.next_piece(self.base, batch.bytes() as u64 + id, &mut buffers.pool)
        {
            let from = piece.start.next_multiple_of(id);
            let count = (piece.end - piece.end % id).saturating_sub(from).min(batch.bytes() as u64);
            self.base = if count > 0 { from } else { piece.end };
            if count > 0 {
                return self.ids(count as usize, buffers).map(Step::Item);
            }
        }
        self.base = self.base.max(sent);
        match self.end {
            Some((length, Tail::Frame(hash))) => {
                Ok(Step::Last(Some(end_of(frame, plain_ids(length), hash)?)))
            }
            _ => Err(LaneViolation::Unit),
        }
    }

    fn ids(&mut self, count: usize, buffers: &mut Buffers) -> Result<Received, LaneViolation> {
        let bytes = buffers.copy(count, self.ahead(count));
        self.passed(count, buffers);
        let batch = IdBatch::new(bytes).map_err(|_| LaneViolation::Unit)?;
        Ok(Received::Frame(FrameMessage::Ids(batch)))
    }

    /// What a unit starts with says what it is.
    fn first_step(
        &mut self,
        ready: usize,
        ended: Option<Tail>,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        let coded = self.first_byte() == Some(CODED_UNIT);
        let begins = coded || self.first_byte() == Some(Kind::Begin.code());
        if self.given_up.is_some_and(|about| about.coded.is_some() != coded) {
            return Err(LaneViolation::Unit);
        }
        let length = match ended {
            Some(_) if ready == 0 => return Ok(Step::Last(Some(Received::Gone))),
            _ if begins && ready >= unit_head(coded) => unit_head(false),
            Some(_) => ready,
            None => return Ok(Step::Wait),
        };
        if coded && length == unit_head(false) {
            self.passed(1, buffers);
        }
        let message = buffers.decode(self.ahead(length))?;
        self.passed(length, buffers);
        match message {
            Message::Frame(FrameMessage::Begin(start)) => {
                self.frame = Some(start.frame);
                self.coded = coded;
                Ok(Step::Item(Received::Frame(FrameMessage::Begin(start))))
            }
            Message::Frame(stats @ FrameMessage::Stats(_)) => Ok(Step::Last(Some(Received::Frame(stats)))),
            Message::Goodbye(reason) => Ok(Step::Last(Some(Received::Goodbye(reason)))),
            _ => Err(LaneViolation::Unit),
        }
    }

    /// The next `count` bytes.
    fn ahead(&self, count: usize) -> impl Iterator<Item = &[u8]> {
        self.store.read(self.base..self.base + count as u64)
    }

    /// The next `count` bytes count as passed on.
    fn passed(&mut self, count: usize, buffers: &mut Buffers) {
        buffers.pool.work += 4 + count as u64 / 8;
        self.base += count as u64;
        self.store.release(self.base, self.base.saturating_sub(RETAINED), &mut buffers.pool);
        self.blocks.release(self.base, &mut buffers.pool);
    }
}

/// How many ids a frame of so many bytes has whose ids travel plain.
const fn plain_ids(length: u64) -> u64 {
    length.saturating_sub(unit_head(false) as u64) / ID_BYTES as u64
}

fn end_of(frame: FrameNumber, ids: u64, hash: u64) -> Result<Received, LaneViolation> {
    let ids = u32::try_from(ids).map_err(|_| LaneViolation::Unit)?;
    Ok(Received::Frame(FrameMessage::End(FrameEnd { frame, ids, hash })))
}
