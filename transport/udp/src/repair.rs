//! Forward error correction: repair shards for the bytes of a block of a frame, which replace any lost ones
//! (Reed-Solomon, by `reed-solomon-simd`).

use std::ops::Range;

use reed_solomon_simd::{decode, encode};

mod budget;

pub use budget::Repair;
pub(crate) use budget::{Budget, Path};

/// The most shards of a block. Longer frames have several blocks, so that their beginnings need not wait for
/// their ends.
pub(crate) const BLOCK: usize = 64;
/// The most repair shards of a block.
pub(crate) const MOST: usize = 32;
/// The largest shard, bytes: no larger datagram is sent.
pub(crate) const LARGEST: usize = 1500;
/// The fewest bytes of a block of several shards with several repair shards. Restoring one costs as much as
/// restoring thousands.
const SMALLEST: usize = 512;
/// The decoder's cost for a block of any size (a Walsh transform over GF(2^16)), in steps of eight bytes.
const DECODER: u64 = 1 << 17;

/// The size of a block's shards: a block of a single shard has a shorter one.
pub(crate) fn shard_size(length: usize, shard: usize) -> usize {
    shard.min(length.next_multiple_of(2))
}

/// Repair shards of a block, cut into shards of `shard` bytes, an even number; the last one is padded with
/// zeros.
pub(crate) fn protect(block: &[u8], shard: usize, count: usize) -> Vec<Vec<u8>> {
    let shards = block.chunks(shard).map(|part| {
        let mut part = part.to_vec();
        part.resize(shard, 0);
        part
    });
    // Impossible counts are refused, and give no repair.
    encode(block.len().div_ceil(shard), count, shards).unwrap_or_default()
}

/// A received repair shard's block, for the bytes `offset..offset + length` of a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Block {
    pub(crate) offset: u64,
    pub(crate) length: u32,
    pub(crate) shard: u16,
    /// The number of repair shards.
    pub(crate) count: u8,
}

impl Block {
    /// Whether such a block is possible.
    pub(crate) fn is_sound(self) -> bool {
        let (length, shard) = (self.length as usize, usize::from(self.shard));
        let sound = (2..=LARGEST).contains(&shard)
            && shard.is_multiple_of(2)
            && (1..=BLOCK * shard).contains(&length)
            && (1..=MOST).contains(&usize::from(self.count));
        sound
            && (self.shard_count() == 1 || self.count == 1 || length >= SMALLEST)
            && self.offset.checked_add(u64::from(self.length)).is_some()
    }

    /// Its range.
    pub(crate) const fn range(self) -> Range<u64> {
        self.offset..self.offset + self.length as u64
    }

    /// The number of its shards.
    pub(crate) fn shard_count(self) -> usize {
        self.length.div_ceil(u32::from(self.shard).max(1)) as usize
    }

    /// The range of a shard.
    pub(crate) fn shard_at(self, index: usize) -> Range<u64> {
        let Range { start, end } = self.range();
        let from = start + index as u64 * u64::from(self.shard);
        from.min(end)..end.min(from + u64::from(self.shard))
    }

    /// The ranges of its shards.
    pub(crate) fn shards(self) -> impl Iterator<Item = Range<u64>> {
        (0..self.shard_count()).map(move |index| self.shard_at(index))
    }

    /// The shards that `range` touches.
    pub(crate) fn shards_in(self, range: Range<u64>) -> Range<usize> {
        let shard = u64::from(self.shard).max(1);
        let Range { start, end } = self.range();
        let from = range.start.clamp(start, end) - start;
        let to = range.end.clamp(start, end) - start;
        (from / shard) as usize..to.div_ceil(shard) as usize
    }

    /// Restores the missing shards, if there are as many `repair` shards, which are named by their index.
    /// `came` has a bit for each received shard, and `read` appends the bytes of one of those.
    pub(crate) fn restore(
        self,
        came: u64,
        read: impl Fn(Range<u64>, &mut Vec<u8>),
        repair: &[(u8, Vec<u8>)],
    ) -> Vec<(u64, Vec<u8>)> {
        let has = |index: usize| came >> index & 1 == 1;
        let all = self.shard_count();
        let there = (0..all).filter(|index| has(*index)).map(|index| {
            let mut bytes = Vec::with_capacity(self.shard.into());
            read(self.shard_at(index), &mut bytes);
            bytes.resize(self.shard.into(), 0);
            (index, bytes)
        });
        let mut restored = match repair {
            [(_, only)] if self.count == 1 && came.count_ones() as usize + 1 == all => {
                // A single repair shard is the sum of all shards; adding them is a thousandth of the
                // decoder's work.
                let mut sum = only.clone();
                there.for_each(|(_, bytes)| sum.iter_mut().zip(bytes).for_each(|(sum, byte)| *sum ^= byte));
                (0..all).filter(|index| !has(*index)).map(|index| (index, sum.clone())).collect()
            }
            _ => {
                let repair = repair.iter().map(|(index, bytes)| (usize::from(*index), bytes));
                decode(all, self.count.into(), there, repair).unwrap_or_default()
            }
        };
        restored.retain(|index, _| !has(*index));
        let cut = |(index, mut bytes): (usize, Vec<u8>)| {
            let range = self.shard_at(index);
            bytes.truncate((range.end - range.start) as usize);
            (range.start, bytes)
        };
        restored.into_iter().map(cut).collect()
    }

    /// The cost of that, in steps of eight bytes or one look-up each.
    pub(crate) fn cost(self) -> u64 {
        let shards = self.shard_count() as u64;
        let read = shards * u64::from(self.shard) / 8;
        if self.count == 1 { 2 * read } else { DECODER + 16 * read }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn one_repair_shard_is_cheap_and_several_cost_a_transform() {
        let block = Block { offset: 0, length: 64_000, shard: 1000, count: 1 };
        assert_eq!(block.cost(), 16_000, "64,000 bytes, read and added");
        assert_eq!(Block { count: 2, ..block }.cost(), 131_072 + 128_000);
    }

    #[test]
    fn a_single_shard_is_padded_to_an_even_length_and_its_repair_is_its_copy() {
        let block = Block { offset: 5, length: 3, shard: 4, count: 1 };
        assert_eq!((block.is_sound(), Block { shard: 3, ..block }.is_sound()), (true, false));
        let repair = [(0, protect(b"abc", 4, 1).remove(0))];
        assert_eq!(block.restore(0, |_, _| {}, &repair), [(5, b"abc".to_vec())]);
    }

    proptest! {
        #[test]
        fn as_many_lost_shards_come_back_as_there_is_repair(
            length in 1usize..4000, shard in 1usize..40, count in 1usize..8, offset in 0u64..1000,
            lost in prop::collection::vec(any::<prop::sample::Index>(), 0..10), seed: u8,
        ) {
            let full = 2 * shard.max(length.div_ceil(BLOCK * 2));
            let shard = shard_size(length, full);
            let block: Vec<u8> = (0..length).map(|at| (at as u8).wrapping_mul(31) ^ seed).collect();
            let about = Block { offset, length: length as u32, shard: shard as u16, count: count as u8 };
            prop_assert!(about.is_sound() || length < SMALLEST);
            let repair: Vec<_> = (0..).zip(protect(&block, shard, count)).collect();
            let shards: Vec<_> = about.shards().collect();
            let gone: Vec<_> = lost.iter().map(|at| at.index(shards.len())).collect();
            prop_assert_eq!((shards.len(), about.shards_in(0..u64::MAX)), (about.shard_count(), 0..shards.len()));
            for (at, shard) in shards.iter().enumerate() {
                prop_assert_eq!(about.shards_in(shard.clone()), at..at + 1);
            }
            let read = |range: Range<u64>, out: &mut Vec<u8>| {
                out.extend_from_slice(&block[(range.start - offset) as usize..(range.end - offset) as usize]);
            };
            let missing = (0..shards.len()).filter(|at| gone.contains(at)).count();
            let came = (0..shards.len()).filter(|at| !gone.contains(at)).fold(0, |came, at| came | 1 << at);
            let needed = repair.len().min(missing.max(1));
            let restored = about.restore(came, read, &repair[repair.len() - needed..]);
            if missing > count {
                prop_assert!(restored.is_empty());
            } else {
                prop_assert_eq!(restored.len(), missing);
                for (start, bytes) in restored {
                    let from = (start - offset) as usize;
                    prop_assert_eq!(&bytes[..], &block[from..from + bytes.len()]);
                }
            }
        }
    }
}
