//! One unit as it is sent.

use std::collections::VecDeque;

use bytes::BytesMut;
use trimaran_net::Instant;
use trimaran_wire::{Format, FrameNumber};

use super::repair_block::RepairBlock;
use crate::chunk::{GivenUp, Tail, unit_head};
use crate::ranges::RangeSet;
use crate::repair::{BLOCK, Block, Budget, Path, protect, shard_size};

mod delivery;
mod write;

#[derive(Debug, Default)]
pub(super) struct Unit {
    /// Bytes from `base` on; data before it is acknowledged.
    pub(super) data: BytesMut,
    base: u64,
    sent: u64,
    acked: RangeSet,
    /// Bytes to retransmit; and lost bytes that may be restored from repair.
    lost: RangeSet,
    waiting: RangeSet,
    /// The blocks that have repair.
    repair_blocks: Vec<RepairBlock>,
    /// The end, once it is known; whether it must be sent; whether it has arrived.
    end: Option<Tail>,
    end_due: bool,
    end_acked: bool,
    /// Parts do not cross multiples of it, so that a lost packet is one lost shard.
    shard: usize,
    /// Up to here repair was made, or was not wanted.
    protected: u64,
    repair: VecDeque<Repair>,
    deadline: Option<Instant>,
    given_up: Option<GivingUp>,
    /// The frame number, if it is a frame.
    frame: Option<FrameNumber>,
    /// Whether its batches are messages.
    pub(super) coded: bool,
    /// The number of items, once it has ended.
    pub(super) items: u32,
    /// The bytes of its beginning, and of an item.
    head: usize,
    item: usize,
}

/// A repair shard to be sent.
#[derive(Debug)]
struct Repair {
    block: Block,
    hash: Option<u64>,
    index: u8,
    data: Vec<u8>,
}

/// A frame that is no longer worth sending.
#[derive(Debug)]
struct GivingUp {
    about: GivenUp,
    head: BytesMut,
    due: bool,
}

impl Unit {
    /// A unit in an empty buffer.
    pub(super) fn new(format: &Format, shard: usize, data: BytesMut) -> Self {
        Self {
            data,
            shard: shard.max(format.item),
            head: unit_head(format, false),
            item: format.item,
            ..Self::default()
        }
    }

    /// A unit that will be a frame.
    pub(super) fn frame(
        frame: FrameNumber,
        format: &Format,
        coded: bool,
        shard: usize,
        data: BytesMut,
    ) -> Self {
        let head = unit_head(format, coded);
        Self { frame: Some(frame), coded, head, ..Self::new(format, shard, data) }
    }

    /// The frame, if it has arrived completely.
    pub(super) fn whole_frame(&self) -> Option<FrameNumber> {
        self.frame.filter(|_| self.has_arrived() && self.given_up.is_none())
    }

    /// Adds the bytes that `write` appends; returns their number.
    pub(super) fn append(&mut self, write: impl FnOnce(&mut BytesMut)) -> usize {
        let before = self.data.len();
        write(&mut self.data);
        self.data.len() - before
    }

    pub(super) fn end(&mut self, tail: Tail) {
        self.end = Some(tail);
        self.end_due = true;
    }

    pub(super) const fn is_ended(&self) -> bool {
        self.end.is_some()
    }

    /// The bytes of the unit so far.
    pub(super) fn written(&self) -> u64 {
        self.base + self.data.len() as u64
    }

    /// Makes repair for the blocks that are complete, or, for a finished frame, for all. A unit that is not a
    /// complete frame gets none.
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
                self.repair_blocks.push(RepairBlock::new(block, hash.is_some()));
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

    /// The deadline of the frame, if it is still worth sending.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.deadline.filter(|_| self.given_up.is_none() && !self.has_arrived())
    }

    pub(super) fn is_late(&self, arrival: Instant) -> bool {
        self.deadline().is_some_and(|deadline| deadline <= arrival)
    }

    /// Returns the number of bytes freed.
    pub(super) fn give_up(&mut self) -> usize {
        let Some(Tail::Frame(hash)) = self.end else { return 0 };
        let length = self.written();
        let unsure = (self.head as u64).saturating_sub(self.base) as usize;
        let freed = self.data.len();
        let mut head = std::mem::take(&mut self.data);
        head.truncate(unsure);
        let coded = self.coded.then_some(self.items.into());
        let about = GivenUp { length, sent: self.sent, hash, coded };
        self.given_up = Some(GivingUp { about, head, due: true });
        self.base = length;
        (self.lost, self.waiting) = Default::default();
        self.repair_blocks.clear();
        self.repair.clear();
        self.end_due = false;
        // From here on the notice of giving up has to arrive, regardless of the end itself.
        self.end_acked = false;
        freed
    }

    pub(super) fn has_arrived(&self) -> bool {
        self.end_acked && self.data.is_empty()
    }
}
