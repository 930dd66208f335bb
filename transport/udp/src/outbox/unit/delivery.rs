//! The delivery status of a unit's parts, and of its repair.

use std::ops::Range;

use bytes::Buf;

use super::Unit;
use crate::outbox::repair_block::{Need, RepairBlock};

impl Unit {
    /// A part has arrived; returns the number of bytes freed.
    pub(in crate::outbox) fn on_ack(&mut self, range: Range<u64>, ended: bool) -> usize {
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

    pub(in crate::outbox) fn on_loss(&mut self, range: Range<u64>, ended: bool) {
        if self.given_up.is_some() {
            return;
        }
        self.end_due |= ended && !self.end_acked;
        let at = range.start;
        let set = if self.repair_block(at).is_some() { &mut self.waiting } else { &mut self.lost };
        self.acked.gaps(range).iter().for_each(|gap| set.insert(gap));
        self.settle(at);
    }

    /// A repair shard of the block at `offset` has arrived; returns the number of bytes freed.
    pub(in crate::outbox) fn on_repair_ack(&mut self, offset: u64, index: u8) -> usize {
        let Some(repair_block) = self.repair_block(offset) else { return 0 };
        repair_block.on_arrived(index);
        let ends = repair_block.ends;
        self.end_acked |= ends;
        self.end_due &= !ends;
        self.settle(offset);
        self.free()
    }

    pub(in crate::outbox) fn on_repair_loss(&mut self, offset: u64, index: u8) {
        if let Some(repair_block) = self.repair_block(offset) {
            repair_block.on_lost(index);
        }
        self.settle(offset);
    }

    /// Retransmits all lost data: nothing is heard of the repair. Returns whether there was any.
    pub(in crate::outbox) fn stop_waiting(&mut self) -> bool {
        let waiting = std::mem::take(&mut self.waiting);
        waiting.iter().for_each(|range| self.lost.insert(range));
        !waiting.is_empty()
    }

    /// The block around `at`, if it has repair.
    fn repair_block(&mut self, at: u64) -> Option<&mut RepairBlock> {
        self.repair_blocks.iter_mut().find(|block| block.range().contains(&at))
    }

    /// Decides about the lost bytes of the block around `at`.
    fn settle(&mut self, at: u64) {
        let mut blocks = self.repair_blocks.iter();
        let Some(repair_block) = blocks.find(|block| block.range().contains(&at)) else { return };
        match repair_block.need(&self.acked, &self.waiting) {
            Need::Restored => {
                self.lost.remove(&repair_block.range());
                self.waiting.remove(&repair_block.range());
                self.acked.insert(repair_block.range());
            }
            Need::Again(shards) => {
                for shard in shards {
                    self.waiting.take(&shard).iter().for_each(|lost| self.lost.insert(lost));
                }
            }
        }
    }

    /// Frees bytes that have arrived; returns their number. Bytes that an incomplete block needs for its
    /// repair are kept.
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

    pub(in crate::outbox) fn on_give_up_ack(&mut self) {
        if let Some(given_up) = &mut self.given_up {
            given_up.due = false;
            self.end_acked = true;
        }
    }

    pub(in crate::outbox) fn on_give_up_loss(&mut self) {
        if let Some(given_up) = &mut self.given_up {
            given_up.due = !self.end_acked;
        }
    }
}
