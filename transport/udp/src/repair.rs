//! Forward error correction: from the bytes of a block of a frame, repair shards that stand in for any of them that are lost
//! (Reed-Solomon, by `reed-solomon-simd`).

use std::ops::Range;

use reed_solomon_simd::{decode, encode};

mod budget;

pub use budget::Repair;
pub(crate) use budget::{Budget, Path};

/// How many shards a block has at most. Longer frames have several blocks, so that their beginnings need not wait for their ends.
pub(crate) const BLOCK: usize = 64;
/// How many repair shards a block has at most.
pub(crate) const MOST: usize = 32;
/// The size of the shards of a block: a block that one shard holds has a shorter one.
pub(crate) fn shard_size(length: usize, shard: usize) -> usize {
    shard.min(length.next_multiple_of(2))
}

/// Repair shards of a block, cut into shards of `shard` bytes, an even number; the last one is filled up with zeros.
pub(crate) fn protect(block: &[u8], shard: usize, count: usize) -> Vec<Vec<u8>> {
    let shards = block.chunks(shard).map(|part| {
        let mut part = part.to_vec();
        part.resize(shard, 0);
        part
    });
    // Refuses counts that cannot be, which gives no repair.
    encode(block.len().div_ceil(shard), count, shards).unwrap_or_default()
}

/// A repair shard as it is received, for the bytes `offset..offset + length` of a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Block {
    pub(crate) offset: u64,
    pub(crate) length: u32,
    pub(crate) shard: u16,
    /// How many repair shards there are.
    pub(crate) count: u8,
}

impl Block {
    /// Whether there can be such a block.
    pub(crate) fn is_sound(self) -> bool {
        let (length, shard) = (self.length as usize, usize::from(self.shard));
        let sound = shard >= 2 && shard.is_multiple_of(2) && (1..=BLOCK * shard).contains(&length);
        sound
            && (1..=MOST).contains(&usize::from(self.count))
            && self.offset.checked_add(u64::from(self.length)).is_some()
    }

    /// Where its shards lie.
    pub(crate) fn shards(self) -> impl Iterator<Item = Range<u64>> {
        let end = self.offset + u64::from(self.length);
        (self.offset..end)
            .step_by(usize::from(self.shard).max(1))
            .map(move |from| from..end.min(from + u64::from(self.shard)))
    }

    /// Restores the shards that are missing; `present` gives the bytes of one that is there, and `repair` shards by index.
    pub(crate) fn restore<'a>(
        self,
        present: impl Fn(Range<u64>) -> Option<&'a [u8]>,
        repair: &[(u8, Vec<u8>)],
    ) -> Vec<(u64, Vec<u8>)> {
        let (mut there, mut missing) = (Vec::new(), Vec::new());
        for (index, range) in self.shards().enumerate() {
            match present(range.clone()) {
                Some(bytes) => {
                    let mut bytes = bytes.to_vec();
                    bytes.resize(usize::from(self.shard), 0);
                    there.push((index, bytes));
                }
                None => missing.push((index, range)),
            }
        }
        if missing.is_empty() || missing.len() > repair.len() {
            return Vec::new();
        }
        let all = there.len() + missing.len();
        let repair = repair.iter().map(|(index, bytes)| (usize::from(*index), bytes));
        let Ok(mut restored) = decode(all, self.count.into(), there, repair) else { return Vec::new() };
        missing
            .into_iter()
            .filter_map(|(index, range)| {
                let mut bytes = restored.remove(&index)?;
                bytes.truncate((range.end - range.start) as usize);
                Some((range.start, bytes))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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
            prop_assert!(about.is_sound());
            let repair: Vec<_> = (0..).zip(protect(&block, shard, count)).collect();
            let shards: Vec<_> = about.shards().collect();
            let gone: Vec<_> = lost.iter().map(|at| at.index(shards.len())).collect();
            let present = |range: Range<u64>| {
                let at = shards.iter().position(|shard| *shard == range)?;
                let bytes = block.get((range.start - offset) as usize..(range.end - offset) as usize);
                bytes.filter(|_| !gone.contains(&at))
            };
            let missing = (0..shards.len()).filter(|at| gone.contains(at)).count();
            let restored = about.restore(present, &repair);
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
