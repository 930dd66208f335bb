//! The blocks of a unit with repair. Missing shards are counted, so each block is restored once, when it can
//! be.

use std::collections::BTreeMap;
use std::ops::Range;

use super::LaneViolation;
use super::store::{Pool, Store};
use crate::repair::Block;

/// Blocks by offset. They do not overlap: otherwise the same bytes could be restored over and over.
#[derive(Debug, Default)]
pub(super) struct Blocks {
    known: BTreeMap<u64, Guarded>,
    /// The end of the last forgotten block, all of whose bytes were delivered.
    forgotten: u64,
    /// How many repair shards are kept.
    kept: usize,
}

/// A block, and its received shards.
#[derive(Debug)]
pub(super) struct Guarded {
    pub(super) block: Block,
    /// A bit for each complete shard.
    pub(super) came: u64,
    /// Repair shards by their index.
    pub(super) repair: Vec<(u8, Vec<u8>)>,
}

impl Guarded {
    fn missing(&self) -> usize {
        self.block.shard_count() - self.came.count_ones() as usize
    }

    /// Updates the shards that `range` touches.
    fn look(&mut self, range: Range<u64>, store: &Store, pool: &mut Pool) {
        for index in self.block.shards_in(range) {
            let shard = self.block.shard_at(index);
            pool.work += 2 + (shard.end - shard.start) / 64;
            self.came |= u64::from(store.has(shard)) << index;
        }
    }
}

impl Blocks {
    pub(super) const fn kept(&self) -> usize {
        self.kept
    }

    /// Whether a repair shard of `block` is useful: some of the block is missing.
    pub(super) fn wants(&self, block: Block, store: &Store, pool: &mut Pool) -> Result<bool, LaneViolation> {
        pool.work += 16;
        if let Some(known) = self.known.get(&block.offset).filter(|known| known.block == block) {
            return Ok(known.missing() > 0);
        }
        let range = block.range();
        pool.work += u64::from(block.length) / 64;
        if store.has(range.clone()) || range.end <= self.forgotten {
            return Ok(false);
        }
        let before =
            self.known.range(..range.end).next_back().map_or(0, |(_, known)| known.block.range().end);
        if range.start < before.max(self.forgotten) { Err(LaneViolation::Block) } else { Ok(true) }
    }

    /// Keeps a repair shard of a block that [`Blocks::wants`] it.
    pub(super) fn keep(&mut self, block: Block, index: u8, data: &[u8], store: &Store, pool: &mut Pool) {
        let known = self.known.entry(block.offset).or_insert_with(|| {
            let mut made = Guarded { block, came: 0, repair: Vec::new() };
            made.look(block.range(), store, pool);
            made
        });
        if known.repair.iter().all(|(known, _)| *known != index) {
            pool.work += data.len() as u64 / 8;
            known.repair.push((index, data.to_vec()));
            self.kept += 1;
        }
    }

    /// Bytes of `range` came: returns the blocks among those that it touches that can be restored now. Their
    /// repair is no longer kept.
    pub(super) fn restorable(&mut self, range: Range<u64>, store: &Store, pool: &mut Pool) -> Vec<Guarded> {
        let mut restorable = Vec::new();
        if self.known.is_empty() || range.is_empty() {
            return restorable;
        }
        let touched = self.known.range_mut(..range.end).rev();
        for (_, known) in touched.take_while(|(_, known)| known.block.range().end > range.start) {
            pool.work += 8;
            if known.repair.is_empty() {
                continue;
            }
            known.look(range.clone(), store, pool);
            if known.missing() <= known.repair.len() {
                let repair = std::mem::take(&mut known.repair);
                self.kept -= repair.len();
                if known.missing() > 0 {
                    restorable.push(Guarded { block: known.block, came: known.came, repair });
                    known.came = u64::MAX >> (64 - known.block.shard_count());
                }
            }
        }
        restorable
    }

    /// Data before `base` was delivered.
    pub(super) fn release(&mut self, base: u64, pool: &mut Pool) {
        while let Some(first) = self.known.first_entry().filter(|first| first.get().block.range().end <= base)
        {
            let over = first.remove();
            pool.work += 8;
            self.kept -= over.repair.len();
            self.forgotten = over.block.range().end;
        }
    }

    /// No more data comes.
    pub(super) fn clear(&mut self) {
        self.known.clear();
        self.kept = 0;
    }
}
