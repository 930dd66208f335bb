//! A block of a unit with repair: which parts the receiver can do without, by the arrivals.

use std::ops::Range;

use crate::ranges::RangeSet;
use crate::repair::Block;

/// A block, and the delivery status of its repair shards.
#[derive(Debug)]
pub(super) struct RepairBlock {
    block: Block,
    /// Whether its repair shards also mark the end of the frame.
    ends: bool,
    /// Repair shards by index, as bits: arrived ones, and those found lost. Probes may count one as lost that
    /// arrives.
    arrived: u32,
    lost: u32,
}

/// The action for the lost shards of a block.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Need {
    /// Nothing: the receiver has restored them.
    Restored,
    /// Retransmit these. The others can be restored, or will be once more has arrived.
    Again(Vec<Range<u64>>),
}

impl RepairBlock {
    pub(super) const fn new(block: Block, ends: bool) -> Self {
        Self { block, ends, arrived: 0, lost: 0 }
    }

    pub(super) const fn range(&self) -> Range<u64> {
        self.block.offset..self.block.offset + self.block.length as u64
    }

    pub(super) const fn tells_the_end(&self) -> bool {
        self.ends
    }

    pub(super) const fn on_arrived(&mut self, index: u8) {
        self.arrived |= 1 << index;
    }

    pub(super) const fn on_lost(&mut self, index: u8) {
        self.lost |= 1 << index;
    }

    /// The action if the bytes `acked` have arrived and those `waiting` were lost. Only shards are
    /// retransmitted that the repair, arrived or still in flight, cannot make up for.
    pub(super) fn need(&self, acked: &RangeSet, waiting: &RangeSet) -> Need {
        let (mut missing, mut lost) = (0, Vec::new());
        for shard in self.block.shards() {
            missing += u32::from(acked.end_of_run(shard.start) < shard.end);
            lost.extend(waiting.overlaps(&shard).then_some(shard));
        }
        if missing <= self.arrived.count_ones() {
            return Need::Restored;
        }
        let gone = (self.lost & !self.arrived).count_ones();
        let hoped = u32::from(self.block.count).saturating_sub(gone) as usize;
        lost.truncate(lost.len().saturating_sub(hoped));
        Need::Again(lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four shards of ten bytes, two of repair.
    fn repair_block() -> RepairBlock {
        RepairBlock::new(Block { offset: 100, length: 35, shard: 10, count: 2 }, true)
    }

    fn set(ranges: &[(u64, u64)]) -> RangeSet {
        let mut set = RangeSet::default();
        ranges.iter().for_each(|(start, end)| set.insert(*start..*end));
        set
    }

    #[test]
    fn as_many_lost_shards_as_repair_may_come_are_waited_for() {
        let mut repair_block = repair_block();
        let acked = set(&[(100, 110)]);
        assert_eq!(repair_block.need(&acked, &set(&[(110, 120), (130, 135)])), Need::Again(vec![]));
        assert_eq!(
            repair_block.need(&acked, &set(&[(110, 135)])),
            Need::Again(std::iter::once(110..120).collect()),
            "one too many"
        );
        repair_block.on_lost(1);
        assert_eq!(
            repair_block.need(&acked, &set(&[(110, 120), (130, 135)])),
            Need::Again(std::iter::once(110..120).collect())
        );
        repair_block.on_arrived(1);
        assert_eq!(
            repair_block.need(&acked, &set(&[(110, 120), (130, 135)])),
            Need::Again(vec![]),
            "it came late"
        );
    }

    #[test]
    fn a_block_is_restored_once_repair_stands_in_for_all_that_is_missing() {
        let mut repair_block = repair_block();
        let lost = set(&[(130, 135)]);
        repair_block.on_arrived(0);
        assert_eq!(
            repair_block.need(&set(&[(100, 120)]), &lost),
            Need::Again(vec![]),
            "one is still under way"
        );
        assert_eq!(repair_block.need(&set(&[(100, 130)]), &lost), Need::Restored);
        assert_eq!(
            repair_block.need(&set(&[(100, 129)]), &lost),
            Need::Again(vec![]),
            "a part of a shard is none"
        );
        repair_block.on_arrived(1);
        repair_block.on_arrived(1);
        assert_eq!(repair_block.need(&set(&[(100, 120)]), &lost), Need::Restored);
        assert_eq!(repair_block.need(&set(&[(100, 110)]), &lost), Need::Again(vec![]), "one counts once");
    }
}
