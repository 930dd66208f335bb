//! One unit as it is received.

use trimaran_wire::{Format, FrameNumber};

use super::blocks::{Blocks, Guarded};
use super::store::{Pool, Store};
use super::{LaneViolation, Received};
use crate::chunk::{GivenUp, Tail, unit_head};
use crate::repair::Block;

mod pass;

#[derive(Debug, Default)]
pub(super) struct Unit {
    pub(super) store: Store,
    /// Data before this was delivered.
    pub(super) base: u64,
    pub(super) highest: u64,
    /// Everything up to here is delivered without waiting for a full batch.
    pause: u64,
    end: Option<(u64, Tail)>,
    frame: Option<FrameNumber>,
    /// Whether its batches are messages, and the number of items delivered.
    coded: bool,
    items: u64,
    /// No more data comes, and there are gaps.
    given_up: Option<GivenUp>,
    blocks: Blocks,
    pub(super) repaired: bool,
}

/// The next item of a unit.
pub(super) enum Step {
    Wait,
    Item(Received),
    /// The unit has ended.
    Last(Option<Received>),
}

impl Unit {
    /// A unit without received data.
    pub(super) fn new(store: Store) -> Self {
        Self { store, ..Self::default() }
    }

    /// The number of repair shards it keeps.
    pub(super) const fn repair_shards(&self) -> usize {
        self.blocks.kept()
    }

    pub(super) const fn is_given_up(&self) -> bool {
        self.given_up.is_some()
    }

    /// Notes the relation of data that ends at `to` to the unit's end.
    pub(super) fn note(&mut self, to: u64, tail: Tail) -> Result<(), LaneViolation> {
        let beyond = self.end.is_some_and(|(end, _)| to > end);
        let ends = matches!(tail, Tail::End | Tail::Frame(_));
        let reached = self.highest.max(self.blocks.end());
        let moved = ends && (self.end.is_some_and(|known| known != (to, tail)) || to < reached);
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

    /// Stores received bytes. Returns the blocks that can be restored now.
    pub(super) fn put(&mut self, offset: u64, data: &[u8], pool: &mut Pool) -> Vec<Guarded> {
        let skip = (self.base.saturating_sub(offset) as usize).min(data.len());
        let (offset, data) = (offset + skip as u64, data.get(skip..).unwrap_or_default());
        self.store.write(offset, data, pool);
        self.blocks.restorable(offset..offset + data.len() as u64, &self.store, pool)
    }

    /// Whether a repair shard of `block` is useful.
    pub(super) fn wants_repair(&self, block: Block, pool: &mut Pool) -> Result<bool, LaneViolation> {
        let is_delivered = block.range().end <= self.base;
        Ok(!is_delivered && self.blocks.wants(block, &self.store, pool)?)
    }

    /// Keeps a useful repair shard. Returns the block if it can be restored now.
    pub(super) fn keep_repair(
        &mut self,
        block: Block,
        index: u8,
        data: &[u8],
        pool: &mut Pool,
    ) -> Vec<Guarded> {
        self.blocks.keep(block, index, data, &self.store, pool);
        self.blocks.restorable(block.offset..block.offset + 1, &self.store, pool)
    }

    /// The missing pieces of a block.
    pub(super) fn restore(&self, found: &Guarded, pool: &mut Pool) -> Vec<(u64, Vec<u8>)> {
        let Guarded { block, came, repair } = found;
        pool.work += block.cost();
        block.restore(*came, |range, out| self.store.read(range).for_each(|piece| out.extend(piece)), repair)
    }

    /// No more of a frame comes; `head` is the end of its beginning.
    pub(super) fn give_up(
        &mut self,
        about: GivenUp,
        head: &[u8],
        format: &Format,
        pool: &mut Pool,
    ) -> Result<(), LaneViolation> {
        let GivenUp { length, sent, hash, coded } = about;
        let begins = unit_head(format, coded.is_some());
        if length < begins as u64 || sent < self.highest {
            return Err(LaneViolation::End);
        }
        self.note(length, Tail::Frame(hash))?;
        self.blocks.clear();
        self.put((begins - head.len().min(begins)) as u64, head, pool);
        if self.store.ready() < length {
            self.given_up = Some(about);
        }
        Ok(())
    }
}
