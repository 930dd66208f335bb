//! A block of a unit with repair: which parts the receiver can do without, by the arrivals.

use std::ops::Range;

use crate::ranges::RangeSet;
use crate::repair::Block;

/// A block, and the delivery status of its repair shards.
#[derive(Debug)]
pub(super) struct RepairBlock {
    block: Block,
    /// Whether its repair shards also mark the end of the frame.
    pub(super) ends: bool,
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
        self.block.range()
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

    fn set(ranges: &[(u64, u64)]) -> RangeSet {
        let mut set = RangeSet::default();
        ranges.iter().for_each(|(start, end)| set.insert(*start..*end));
        set
    }

    /// Four shards of ten bytes, two of repair.
    #[test]
    fn lost_shards_are_waited_for_as_long_as_enough_repair_has_come_or_may_come() {
        let one = || Need::Again(std::iter::once(110..120).collect());
        let none = || Need::Again(vec![]);
        let (second_and_last, last) = (&[(110, 120), (130, 135)][..], &[(130, 135)][..]);
        for (arrived, lost, acked, waiting, need, why) in [
            (&[][..], &[][..], 110, second_and_last, none(), "two may come"),
            (&[], &[], 110, &[(110, 135)], one(), "one too many"),
            (&[], &[1], 110, second_and_last, one(), "one repair shard is lost"),
            (&[1], &[1], 110, second_and_last, none(), "it came late"),
            (&[0], &[], 120, last, none(), "one is still under way"),
            (&[0], &[], 130, last, Need::Restored, "repair stands in for all that is missing"),
            (&[0], &[], 129, last, none(), "a part of a shard is none"),
            (&[0, 1, 1], &[], 120, last, Need::Restored, "both stand in"),
            (&[0, 1, 1], &[], 110, last, none(), "one counts once"),
        ] {
            let block = Block { offset: 100, length: 35, shard: 10, count: 2 };
            let mut repair_block = RepairBlock::new(block, true);
            lost.iter().for_each(|index| repair_block.on_lost(*index));
            arrived.iter().for_each(|index| repair_block.on_arrived(*index));
            assert_eq!(repair_block.need(&set(&[(100, acked)]), &set(waiting)), need, "{why}");
        }
    }
}
