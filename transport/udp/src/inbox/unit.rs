//! One unit of the frames lane as it is received.

use std::ops::Range;

use bytes::BytesMut;
use trimaran_proto::FrameNumber;

use super::{LaneViolation, Received};
use crate::chunk::{GivenUp, Tail, unit_head};
use crate::ranges::RangeSet;
use crate::repair::Block;

mod pass;

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
}
