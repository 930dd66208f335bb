//! One unit of the frames lane as it is received.

use std::ops::Range;

use bytes::{Buf, BytesMut};
use trimaran_proto::{
    BatchSize, FrameEnd, FrameMessage, FrameNumber, HEADER_BYTES, ID_BYTES, IdBatch, Kind, Message,
};

use super::buffers::Buffers;
use super::{LaneViolation, Received};
use crate::chunk::{CODED_UNIT, GivenUp, Tail, unit_head};
use crate::ranges::RangeSet;
use crate::repair::{BLOCK, Block};

/// How much of what was passed on is kept: a block that is not whole yet may need it for its repair. No larger datagram than this
/// allows for is sent.
const RETAINED: u64 = BLOCK as u64 * 1500;

/// Repair shards by index.
type Shards = Vec<(u8, Vec<u8>)>;

#[derive(Debug, Default)]
pub(super) struct Unit {
    /// Bytes from `kept` on, with gaps; those before `base` were passed on.
    data: BytesMut,
    kept: u64,
    pub(super) base: u64,
    have: RangeSet,
    pub(super) highest: u64,
    /// Up to where everything shall be passed on.
    pause: u64,
    end: Option<(u64, Tail)>,
    frame: Option<FrameNumber>,
    /// Whether its batches are messages, and how many ids those passed on had.
    coded: bool,
    ids: u64,
    /// No more comes, and there are gaps.
    given_up: Option<GivenUp>,
    repair: Vec<(Block, Shards)>,
    pub(super) repaired: bool,
}

/// What is next in a unit.
pub(super) enum Step {
    Wait,
    Item(Received),
    /// The unit is over.
    Last(Option<Received>),
}

impl Unit {
    /// A unit that nothing has come of, in a buffer that is empty.
    pub(super) fn new(data: BytesMut) -> Self {
        Self { data, ..Self::default() }
    }

    /// The buffer, for another unit.
    pub(super) fn into_buffer(self) -> BytesMut {
        self.data
    }

    /// How many separate pieces it has.
    pub(super) fn pieces(&self) -> usize {
        self.have.len()
    }

    /// How many repair shards it has.
    pub(super) fn repair_shards(&self) -> usize {
        self.repair.iter().map(|(_, shards)| shards.len()).sum()
    }

    pub(super) const fn is_given_up(&self) -> bool {
        self.given_up.is_some()
    }

    /// Notes how what ends at `to` relates to the unit's end.
    pub(super) fn note(&mut self, to: u64, tail: Tail) -> Result<(), LaneViolation> {
        let beyond = self.end.is_some_and(|(end, _)| to > end);
        let ends = matches!(tail, Tail::End | Tail::Frame(_));
        let moved = ends && (self.end.is_some_and(|known| known != (to, tail)) || to < self.highest);
        if beyond || moved {
            return Err(LaneViolation::End);
        }
        match tail {
            Tail::More => {}
            Tail::Pause => self.pause = self.pause.max(to),
            Tail::End | Tail::Frame(_) => {
                self.end = Some((to, tail));
                self.pause = to;
            }
        }
        Ok(())
    }

    pub(super) fn store(&mut self, offset: u64, data: &[u8]) {
        let skip = (self.base.saturating_sub(offset) as usize).min(data.len());
        let (offset, data) = (offset + skip as u64, data.get(skip..).unwrap_or_default());
        if data.is_empty() {
            return;
        }
        let from = (offset - self.kept) as usize;
        let to = from + data.len();
        if self.data.len() < to {
            self.data.resize(to, 0);
        }
        if let Some(slot) = self.data.get_mut(from..to) {
            slot.copy_from_slice(data);
        }
        self.have.insert(offset..offset + data.len() as u64);
    }

    /// Whether anything of a block is missing.
    pub(super) fn wants_repair(&self, block: Block) -> bool {
        !block.shards().all(|range| self.has(&range))
    }

    /// Keeps a repair shard.
    pub(super) fn keep_repair(&mut self, block: Block, index: u8, data: &[u8]) {
        if !self.wants_repair(block) {
            return;
        }
        let shards = match self.repair.iter_mut().find(|(known, _)| *known == block) {
            Some((_, shards)) => shards,
            None => &mut self.repair.push_mut((block, Vec::new())).1,
        };
        if shards.iter().all(|(known, _)| *known != index) {
            shards.push((index, data.to_vec()));
        }
    }

    /// Restores what can be restored; gives the pieces.
    pub(super) fn restore(&mut self) -> Vec<(u64, Vec<u8>)> {
        let mut restored = Vec::new();
        let mut repair = std::mem::take(&mut self.repair);
        repair.retain(|(block, shards)| {
            let pieces = block.restore(|range| self.present(range), shards);
            let done = !pieces.is_empty() || block.shards().all(|range| self.has(&range));
            restored.extend(pieces);
            !done
        });
        self.repair = repair;
        restored
    }

    /// Whether all of `range` has come.
    fn has(&self, range: &Range<u64>) -> bool {
        range.end <= self.base || self.have.end_of_run(self.base.max(range.start)) >= range.end
    }

    /// The bytes of `range`, if all of them have come and are still kept.
    fn present(&self, range: Range<u64>) -> Option<&[u8]> {
        let from = usize::try_from(range.start.checked_sub(self.kept)?).ok()?;
        let bytes = self.data.get(from..from + (range.end - range.start) as usize)?;
        self.has(&range).then_some(bytes)
    }

    /// Nothing more comes of a frame; `head` is the end of its beginning.
    pub(super) fn give_up(&mut self, about: GivenUp, head: &[u8]) -> Result<(), LaneViolation> {
        let GivenUp { length, sent, hash, coded } = about;
        let begins = unit_head(coded.is_some());
        if length < begins as u64 || sent < self.highest {
            return Err(LaneViolation::End);
        }
        self.note(length, Tail::Frame(hash))?;
        self.store((begins - head.len().min(begins)) as u64, head);
        if self.have.end_of_run(self.base) < length {
            self.given_up = Some(about);
        }
        self.repair.clear();
        Ok(())
    }

    /// Whether [`Unit::step`] would not wait.
    pub(super) fn is_readable(&self, batch: BatchSize) -> bool {
        let ready = self.have.end_of_run(self.base) - self.base;
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

    pub(super) fn step(&mut self, batch: BatchSize, buffers: &mut Buffers) -> Result<Step, LaneViolation> {
        let ready = self.have.end_of_run(self.base) - self.base;
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

    /// Passes on the next batch of a frame whose batches are messages. Behind a gap nobody knows where the next one begins.
    fn coded_step(
        &mut self,
        frame: FrameNumber,
        ready: usize,
        ended: Option<Tail>,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        if let Some(length) = self.message_length(ready)? {
            let (ids, batch) = match self.take(length, |bytes| buffers.decode(bytes))? {
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
        let from = (self.base - self.kept) as usize;
        let ahead = self.data.get(from..).and_then(|ahead| ahead.get(..ready)).unwrap_or_default();
        let Some([kind, length @ ..]) = ahead.first_chunk::<HEADER_BYTES>() else { return Ok(None) };
        let [low, middle, high] = *length;
        let length = u32::from_le_bytes([low, middle, high, 0]) as usize;
        let sound = Kind::from_code(*kind)
            .filter(|kind| matches!(kind, Kind::Ids | Kind::Coded))
            .is_some_and(|kind| kind.lengths().contains(&length));
        if !sound {
            return Err(LaneViolation::Unit);
        }
        Ok(Some(HEADER_BYTES + length).filter(|all| *all <= ready))
    }

    fn first_byte(&self) -> Option<u8> {
        self.data.first().copied()
    }

    /// Passes on the ids that have come, wherever they are, and then the end that says how many there were.
    fn step_over_gaps(
        &mut self,
        frame: FrameNumber,
        sent: u64,
        batch: BatchSize,
        buffers: &mut Buffers,
    ) -> Result<Step, LaneViolation> {
        let whole_ids = |range: Range<u64>| {
            let id = ID_BYTES as u64;
            range.start.max(self.base).next_multiple_of(id)..range.end - range.end % id
        };
        let next = self.have.iter().map(whole_ids).find(|range| range.start < range.end);
        if let Some(range) = next {
            self.base = range.start;
            let count = (range.end - range.start).min(batch.bytes() as u64);
            return self.ids(count as usize, buffers).map(Step::Item);
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
        let bytes = self.take(count, |bytes| buffers.copy(bytes));
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
            self.take(1, |_| ());
        }
        match self.take(length, |bytes| buffers.decode(bytes))? {
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

    /// Gives the next `count` bytes to `pass`; from here on they count as passed on.
    fn take<T>(&mut self, count: usize, pass: impl FnOnce(&[u8]) -> T) -> T {
        let from = (self.base - self.kept) as usize;
        let passed = pass(self.data.get(from..from + count).unwrap_or_default());
        self.base += count as u64;
        self.have.remove(&(0..self.base));
        // Not each time: moving the beginning costs.
        if self.base - self.kept > 2 * RETAINED {
            let gone = self.base - RETAINED - self.kept;
            self.data.advance(gone as usize);
            self.kept += gone;
        }
        passed
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
