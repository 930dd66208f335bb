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

    /// The end of the last known block; they do not overlap.
    pub(super) fn end(&self) -> u64 {
        self.known.values().next_back().map_or(0, |known| known.block.range().end)
    }

    /// Whether a repair shard of `block` is useful: some of the block is missing.
    pub(super) fn wants(&self, block: Block, store: &Store, pool: &mut Pool) -> Result<bool, LaneViolation> {
        pool.work += 16;
        if let Some(known) = self.known.get(&block.offset).filter(|known| known.block == block) {
            return Ok(known.missing() > 0);
        }
        let range = block.range();
        pool.work += u64::from(block.length) / 64;
        if store.has(range.clone()) {
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

#[cfg(test)]
mod tests {
    use trimaran_wire::BatchSize;

    use crate::chunk::{GivenUp, Tail};
    use crate::inbox::Inbox;
    use crate::inbox::tests::{all, empty, unit_of};
    use crate::repair::Block;
    use crate::samples::FORMAT;

    type Act = fn(&mut Inbox);

    /// Bytes of unit 0 come; its head has 80.
    fn put(inbox: &mut Inbox, from: usize, to: usize, tail: Tail) {
        let bytes = unit_of(&FORMAT, &[7; 100_004]);
        inbox.put(0, from as u64, tail, &bytes[from..to]).unwrap();
    }

    /// One of two repair shards comes, for two shards from `offset` on.
    fn put_repair(inbox: &mut Inbox, offset: u64) {
        let block = Block { offset, length: 1024, shard: 512, count: 2 };
        inbox.put_repair(0, block, None, 0, &[7; 512]).unwrap();
    }

    fn give_up(inbox: &mut Inbox, length: u64) {
        inbox.give_up(0, GivenUp { length, sent: length, hash: 7, coded: None }, &[]).unwrap();
    }

    fn take(inbox: &mut Inbox) {
        assert!(inbox.take().unwrap().is_some());
    }

    /// A step is eight bytes or one look-up. A chunk costs 16 of them, and a new page 288.
    #[test]
    fn all_that_is_done_for_a_unit_is_counted_in_steps() {
        let mut inbox = empty();
        let acts: [(u64, &str, Act); 14] = [
            (321, "a page is made", |inbox| put(inbox, 0, 80, Tail::More)),
            (14, "the beginning is decoded", take),
            (297, "the page is filled, word by word", |inbox| put(inbox, 80, 2048, Tail::More)),
            (318, "another page, behind two that are left out", |inbox| put(inbox, 6144, 6208, Tail::More)),
            (150, "repair is kept, and both shards are looked for", |inbox| put_repair(inbox, 2048)),
            (16, "nothing comes, in the block", |inbox| put(inbox, 2100, 2100, Tail::Pause)),
            (310, "a third page, of which the block has no part", |inbox| put(inbox, 3072, 3080, Tail::More)),
            (194, "the block is whole: nothing is restored", |inbox| put(inbox, 2048, 3072, Tail::Pause)),
            (394, "three batches are copied, and the block is over", |inbox| drop(all(inbox))),
            (17, "no more comes", |inbox| {
                inbox.set_batch(BatchSize::new(15).unwrap());
                give_up(inbox, 6208);
            }),
            (7, "the items before the gap", take),
            (30, "a batch behind the gap: no more than that is looked at", take),
            (7, "the last item", take),
            (36, "the end: no word of the page has more, and the pages are given back", take),
        ];
        for (steps, why, act) in acts {
            let before = inbox.work();
            act(&mut inbox);
            assert_eq!(inbox.work() - before, steps, "{why}");
        }
    }

    #[test]
    fn repair_counts_as_kept_until_its_block_or_its_unit_is_over() {
        let cases: [(usize, &str, Act, Act); 3] = [
            (1, "it is waited for", |inbox| put(inbox, 0, 80, Tail::More), take),
            (0, "no more comes", |inbox| put(inbox, 0, 80, Tail::More), |inbox| give_up(inbox, 2000)),
            (
                0,
                "the block was delivered long before",
                |inbox| {
                    put(inbox, 0, 100_080, Tail::Pause);
                    all(inbox);
                },
                |inbox| {
                    put(inbox, 100_080, 100_084, Tail::Pause);
                    take(inbox);
                },
            ),
        ];
        for (kept, why, before, behind) in cases {
            let mut inbox = empty();
            before(&mut inbox);
            put_repair(&mut inbox, 0);
            behind(&mut inbox);
            assert_eq!(inbox.repair, kept, "{why}");
        }
    }
}
