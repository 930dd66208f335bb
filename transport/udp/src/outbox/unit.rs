//! One unit of the frames lane as it is sent.

use std::collections::VecDeque;
use std::ops::Range;

use bytes::{Buf, BufMut, BytesMut};
use trimaran_proto::{FrameNumber, Instant};

use super::guard::{Guard, Need};
use super::write_if_fits;
use crate::chunk::{Chunk, GivenUp, Tail, part_overhead, unit_head};
use crate::ranges::RangeSet;
use crate::recovery::Content;
use crate::repair::{BLOCK, Block, Budget, Path, protect, shard_size};

#[derive(Debug)]
pub(super) struct Unit {
    /// Bytes from `base` on; what lies before is acknowledged.
    data: BytesMut,
    base: u64,
    sent: u64,
    acked: RangeSet,
    /// What has to be sent again; and what was lost as well, but may be restored from repair.
    lost: RangeSet,
    waiting: RangeSet,
    /// The blocks that have repair.
    guards: Vec<Guard>,
    /// The end, once it is known, and whether it must be sent, and whether it has arrived.
    end: Option<Tail>,
    end_due: bool,
    end_acked: bool,
    /// Parts do not reach over multiples of it, so that a lost packet is one lost shard.
    shard: usize,
    /// Up to where repair was made, or was not wanted.
    protected: u64,
    repair: VecDeque<Repair>,
    deadline: Option<Instant>,
    given_up: Option<GivingUp>,
    /// The frame that it is, if it is one.
    frame: Option<FrameNumber>,
    /// Whether its batches are messages.
    coded: bool,
    /// How many ids it has, once it is over.
    ids: u32,
}

/// A repair shard that waits to be sent.
#[derive(Debug)]
struct Repair {
    block: Block,
    hash: Option<u64>,
    index: u8,
    data: Vec<u8>,
}

/// A frame that is not worth sending any more.
#[derive(Debug)]
struct GivingUp {
    about: GivenUp,
    head: BytesMut,
    due: bool,
}

impl Unit {
    pub(super) fn new(shard: usize) -> Self {
        Self {
            data: BytesMut::new(),
            base: 0,
            sent: 0,
            acked: RangeSet::default(),
            lost: RangeSet::default(),
            waiting: RangeSet::default(),
            guards: Vec::new(),
            end: None,
            end_due: false,
            end_acked: false,
            shard: shard.max(4),
            protected: 0,
            repair: VecDeque::new(),
            deadline: None,
            given_up: None,
            frame: None,
            coded: false,
            ids: 0,
        }
    }

    /// A unit that will be a frame.
    pub(super) fn frame(frame: FrameNumber, coded: bool, shard: usize) -> Self {
        Self { frame: Some(frame), coded, ..Self::new(shard) }
    }

    pub(super) const fn is_coded(&self) -> bool {
        self.coded
    }

    pub(super) const fn set_ids(&mut self, ids: u32) {
        self.ids = ids;
    }

    /// The frame, if all of it has arrived.
    pub(super) fn whole_frame(&self) -> Option<FrameNumber> {
        self.frame.filter(|_| self.has_arrived() && self.given_up.is_none())
    }

    pub(super) fn append(&mut self, bytes: &[u8]) {
        self.data.put_slice(bytes);
    }

    pub(super) fn end(&mut self, tail: Tail) {
        self.end = Some(tail);
        self.end_due = true;
    }

    pub(super) const fn is_ended(&self) -> bool {
        self.end.is_some()
    }

    /// How many bytes the unit has so far.
    pub(super) fn written(&self) -> u64 {
        self.base + self.data.len() as u64
    }

    /// Makes repair for the blocks that are complete, or, of a frame that is over, for all. What is no whole frame gets none.
    pub(super) fn protect(&mut self, budget: &mut Budget, path: Path) {
        let over = self.is_ended();
        if !budget.is_open() || self.end == Some(Tail::End) {
            self.protected = u64::MAX;
            return;
        }
        let full = (BLOCK * self.shard) as u64;
        while self.protected < self.written() && (over || self.written() - self.protected >= full) {
            let end = self.written().min(self.protected + full);
            let hash = match self.end {
                Some(Tail::Frame(hash)) if end == self.written() => Some(hash),
                _ => None,
            };
            let from = self.protected.saturating_sub(self.base) as usize;
            let bytes = self.data.get(from..(end - self.base) as usize).unwrap_or_default();
            let shard = shard_size(bytes.len(), self.shard);
            let count = budget.spend(bytes.len(), shard, path);
            if count > 0 {
                let (length, count_u8) = (bytes.len() as u32, count as u8);
                let block = Block { offset: self.protected, length, shard: shard as u16, count: count_u8 };
                self.guards.push(Guard::new(block, hash.is_some()));
                let shards = (0..).zip(protect(bytes, shard, count));
                self.repair.extend(shards.map(|(index, data)| Repair { block, hash, index, data }));
            }
            self.protected = end;
        }
    }

    pub(super) fn due_by(&mut self, deadline: Instant) {
        if matches!(self.end, Some(Tail::Frame(_))) {
            self.deadline.get_or_insert(deadline);
        }
    }

    /// By when the frame has to arrive, if that is still worth something.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.deadline.filter(|_| self.given_up.is_none() && !self.has_arrived())
    }

    pub(super) fn is_late(&self, arrival: Instant) -> bool {
        self.deadline().is_some_and(|deadline| deadline <= arrival)
    }

    /// Says how many bytes that freed.
    pub(super) fn give_up(&mut self) -> usize {
        let Some(Tail::Frame(hash)) = self.end else { return 0 };
        let length = self.written();
        let unsure = (unit_head(self.coded) as u64).saturating_sub(self.base) as usize;
        let freed = self.data.len();
        let mut head = std::mem::take(&mut self.data);
        head.truncate(unsure);
        let coded = self.coded.then_some(self.ids.into());
        let about = GivenUp { length, sent: self.sent, hash, coded };
        self.given_up = Some(GivingUp { about, head, due: true });
        self.base = length;
        self.lost = RangeSet::default();
        self.waiting = RangeSet::default();
        self.guards.clear();
        self.repair.clear();
        self.end_due = false;
        // From here on it is the word of giving up that has to arrive, whatever became of the end itself.
        self.end_acked = false;
        freed
    }

    pub(super) fn has_due(&self, credit: u64) -> bool {
        if let Some(given_up) = &self.given_up {
            return given_up.due;
        }
        let fresh = self.sent < self.written();
        !self.lost.is_empty()
            || fresh && credit > 0
            || !fresh && (self.is_end_due() || !self.repair.is_empty())
    }

    /// Whether the end has to be said by itself. An end whose bytes may be restored waits for what becomes of them.
    fn is_end_due(&self) -> bool {
        let waits = self.waiting.iter().next_back().is_some_and(|range| range.end == self.written());
        self.end_due && !waits
    }

    /// Writes the chunk that is due; gives what it carries and how many bytes of it were never sent before.
    pub(super) fn write(
        &mut self,
        number: u64,
        credit: u64,
        room: usize,
        whole: usize,
        out: &mut Vec<u8>,
    ) -> Option<(Content, u64)> {
        if let Some(GivingUp { about, head, due }) = &mut self.given_up {
            let chunk = Chunk::GiveUp { unit: number, about: *about, head };
            write_if_fits(&chunk, room, out)?;
            *due = false;
            return Some((Content::GiveUp { unit: number }, 0));
        }
        let written = self.written();
        let overhead = part_overhead(number, written);
        let fresh = (written - self.sent).min(credit);
        let lost = self.lost.iter().next();
        let wanted = match lost {
            Some(range) => range,
            None if fresh > 0 => self.sent..self.sent + fresh,
            None if self.is_end_due() => self.sent..self.sent,
            None => return self.write_repair(number, room, out).map(|content| (content, 0)),
        };
        let shard = self.shard as u64;
        let wanted = wanted.start..wanted.end.min((wanted.start / shard + 1) * shard);
        let most = room.checked_sub(overhead)? as u64;
        let size = wanted.end - wanted.start;
        let fits_alone = size as usize + overhead <= whole;
        if size > most && (fits_alone || most < 4) {
            return None;
        }
        let range = wanted.start..wanted.end.min(wanted.start + (most & !3));
        self.lost.remove(&range);
        let first_time = range.end.saturating_sub(self.sent);
        self.sent = self.sent.max(range.end);
        let last = range.end == written;
        let tail = if last { self.end.unwrap_or(Tail::Pause) } else { Tail::More };
        let ended = last && self.end.is_some();
        self.end_due &= !ended;
        let from = range.start.saturating_sub(self.base) as usize;
        let to = range.end.saturating_sub(self.base) as usize;
        let data = self.data.get(from..to).unwrap_or_default();
        Chunk::Part { unit: number, offset: range.start, tail, data }.write(out);
        Some((Content::Part { unit: number, range, ended }, first_time))
    }

    fn write_repair(&mut self, number: u64, room: usize, out: &mut Vec<u8>) -> Option<Content> {
        let Repair { block, hash, index, data } = self.repair.front()?;
        let chunk = Chunk::Repair { unit: number, block: *block, hash: *hash, index: *index, data };
        write_if_fits(&chunk, room, out)?;
        let content = Content::Repair { unit: number, offset: block.offset, index: *index };
        self.repair.pop_front();
        Some(content)
    }

    /// A part has arrived; says how many bytes that freed.
    pub(super) fn on_ack(&mut self, range: Range<u64>, ended: bool) -> usize {
        if self.given_up.is_some() {
            return 0;
        }
        let at = range.start;
        self.lost.remove(&range);
        self.waiting.remove(&range);
        self.acked.insert(range);
        self.end_acked |= ended;
        self.settle(at);
        self.free()
    }

    pub(super) fn on_loss(&mut self, range: Range<u64>, ended: bool) {
        if self.given_up.is_some() {
            return;
        }
        self.end_due |= ended && !self.end_acked;
        let at = range.start;
        let set = if self.guard(at).is_some() { &mut self.waiting } else { &mut self.lost };
        for gap in self.acked.gaps(range) {
            set.insert(gap);
        }
        self.settle(at);
    }

    /// A repair shard of the block at `offset` has arrived; says how many bytes that freed.
    pub(super) fn on_repair_ack(&mut self, offset: u64, index: u8) -> usize {
        let Some(guard) = self.guard(offset) else { return 0 };
        guard.on_arrived(index);
        let ends = guard.tells_the_end();
        self.end_acked |= ends;
        self.end_due &= !ends;
        self.settle(offset);
        self.free()
    }

    pub(super) fn on_repair_loss(&mut self, offset: u64, index: u8) {
        if let Some(guard) = self.guard(offset) {
            guard.on_lost(index);
        }
        self.settle(offset);
    }

    /// Sends all again that was lost: nothing is heard of the repair.
    pub(super) fn stop_waiting(&mut self) {
        for range in std::mem::take(&mut self.waiting).iter() {
            self.lost.insert(range);
        }
    }

    /// The block that `at` lies in, if it has repair.
    fn guard(&mut self, at: u64) -> Option<&mut Guard> {
        self.guards.iter_mut().find(|guard| guard.range().contains(&at))
    }

    /// Decides what becomes of the lost bytes of the block that `at` lies in.
    fn settle(&mut self, at: u64) {
        let Some(guard) = self.guards.iter().find(|guard| guard.range().contains(&at)) else { return };
        match guard.need(&self.acked, &self.waiting) {
            Need::Restored => {
                self.lost.remove(&guard.range());
                self.waiting.remove(&guard.range());
                self.acked.insert(guard.range());
            }
            Need::Again(shards) => {
                for shard in shards {
                    for lost in self.waiting.take(&shard).iter() {
                        self.lost.insert(lost);
                    }
                }
            }
        }
    }

    /// Forgets the bytes that have arrived; says how many. What a block that is not complete yet needs for its repair is kept.
    fn free(&mut self) -> usize {
        let done = self.acked.end_of_run(self.base).min(self.protected.max(self.base));
        let freed = ((done - self.base) as usize).min(self.data.len());
        self.data.advance(freed);
        self.base = done;
        if self.has_arrived() {
            self.repair.clear();
        }
        freed
    }

    pub(super) fn on_give_up_ack(&mut self) {
        if let Some(given_up) = &mut self.given_up {
            given_up.due = false;
            self.end_acked = true;
        }
    }

    pub(super) fn on_give_up_loss(&mut self) {
        if let Some(given_up) = &mut self.given_up {
            given_up.due = !self.end_acked;
        }
    }

    pub(super) fn has_arrived(&self) -> bool {
        self.end_acked && self.data.is_empty()
    }
}
