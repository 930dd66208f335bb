//! Forward error correction: from the bytes of a block of a frame, repair shards that stand in for any of them that are lost
//! (Reed-Solomon, by `reed-solomon-simd`).

use std::ops::Range;

use reed_solomon_simd::{decode, encode};

/// How many shards a block has at most. Longer frames have several blocks, so that their beginnings need not wait for their ends.
pub(crate) const BLOCK: usize = 64;
/// How many repair shards a block has at most.
pub(crate) const MOST: usize = 32;
/// How often a block may be lost in spite of its repair, so that it waits for a repetition.
const FAILURES: f64 = 1e-3;
/// Below this share of lost packets a path is clean.
const CLEAN: f64 = 5e-4;
/// The share of losses that is taken for granted where repair is always sent.
const EXPECTED: f64 = 0.01;
/// What a packet has beside its bytes of a frame, about: this protocol's fields and tag, and the headers of UDP and IPv4.
const BESIDE: usize = 70;
/// A frame of fewer packets is not cut smaller: the packets would cost more than the repair.
const FEW: usize = 7;
/// How many bytes of repair may be saved up for later.
const SAVINGS: f64 = 64.0 * 1024.0;

/// When frames get repair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Repair {
    /// Never: what is lost is sent again.
    Off,
    /// While packets are lost, as much as the share that is lost asks for.
    #[default]
    Auto,
    /// Always, on a clean path as if a hundredth of the packets were lost: so that the first loss costs no time either.
    On,
}

/// What may be spent on repair: a share of the bytes sent.
#[derive(Debug)]
pub(crate) struct Budget {
    share: f64,
    saved: f64,
    /// The share of losses that is taken for granted.
    expected: f64,
}

impl Budget {
    pub(crate) fn new(when: Repair, percent: u8) -> Self {
        let percent = if when == Repair::Off { 0 } else { percent };
        let expected = if when == Repair::On { EXPECTED } else { 0.0 };
        Self { share: f64::from(percent) / 100.0, saved: 0.0, expected }
    }

    pub(crate) const fn is_open(&self) -> bool {
        self.share > 0.0
    }

    /// How many repair shards a block of `length` bytes gets, where that share of packets is lost: as many as it needs and as are
    /// left of the share, but one at least. So a frame of few packets has more than its share; it is small.
    pub(crate) fn spend(&mut self, length: usize, shard: usize, loss: f64) -> usize {
        let loss = loss.max(self.expected);
        let shards = length.div_ceil(shard.max(1));
        let bytes = (length + shards * BESIDE) as f64;
        self.saved = (self.saved + bytes * self.share).min(SAVINGS);
        if loss < CLEAN || shard == 0 || length == 0 || !self.is_open() {
            return 0;
        }
        let cost = (shard + BESIDE) as f64;
        let affordable = (self.saved / cost) as usize;
        let count = needed(shards, loss).min(affordable.max(1));
        self.saved = (self.saved - count as f64 * cost).max(0.0);
        count
    }

    /// The size of the shards of a frame that will have about `length` bytes, at most `most`: smaller where more of them can afford
    /// the repair that they need. Two of 12 shards are a sixth, two of 14 a seventh.
    pub(crate) fn shard(&self, length: usize, most: usize, loss: f64) -> usize {
        let loss = loss.max(self.expected);
        let fewest = length.div_ceil(most.max(1));
        if loss < CLEAN || !self.is_open() || !(FEW..=BLOCK / 2).contains(&fewest) {
            return most;
        }
        let affords = |shards: &usize| needed(*shards, loss) as f64 <= self.share * *shards as f64;
        let shards = (fewest..=fewest + fewest / 3).find(affords);
        shards.map_or(most, |shards| length.div_ceil(shards).next_multiple_of(16).min(most))
    }
}

/// The fewest repair shards with which a block of so many shards is whole but for one time in a thousand, if losses are independent.
fn needed(shards: usize, loss: f64) -> usize {
    (1..MOST).find(|repair| more_lost_than(*repair, shards + repair, loss) <= FAILURES).unwrap_or(MOST)
}

/// How probable it is that of `all` packets more than `most` are lost.
fn more_lost_than(most: usize, all: usize, loss: f64) -> f64 {
    let keep = 1.0 - loss.min(0.99);
    let mut exactly = keep.powi(all as i32);
    let mut at_most = exactly;
    for lost in 1..=most {
        exactly *= (all - lost + 1) as f64 / lost as f64 * loss / keep;
        at_most += exactly;
    }
    1.0 - at_most
}

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

    #[test]
    fn a_clean_path_has_no_repair_and_a_bad_one_as_much_as_is_allowed() {
        let mut budget = Budget::new(Repair::Auto, 15);
        assert_eq!(budget.spend(15 * 1136, 1136, 0.0), 0);
        assert_eq!(budget.spend(15 * 1136, 1136, 0.01), 2, "needed");
        for _ in 0..100 {
            budget.spend(15 * 1136, 1136, 0.3);
        }
        let spent: usize = (0..100).map(|_| budget.spend(20 * 1136, 1136, 0.3)).sum();
        assert_eq!(spent, 300, "15 % of 2000");
        let few: usize = (0..100).map(|_| budget.spend(2 * 1136, 1136, 0.01)).sum();
        assert!((100..=101).contains(&few), "a frame of two packets has one of repair: {few}");
        for none in [Budget::new(Repair::Auto, 0), Budget::new(Repair::Off, 15)] {
            assert!(!none.is_open());
        }
    }

    #[test]
    fn shards_are_as_small_as_makes_their_repair_affordable() {
        let budget = Budget::new(Repair::Auto, 15);
        // 4,000 ids: 12 packets at the usual size, of which two of repair would be a sixth.
        assert_eq!(budget.shard(16_080, 1376, 0.01), 1152, "14 and two");
        assert_eq!(budget.shard(16_080, 1136, 0.01), 1072, "15 alike and two");
        assert_eq!(budget.shard(16_080, 1376, 0.0), 1376, "a clean path");
        assert_eq!(budget.shard(16_080, 1376, 0.2), 1376, "out of reach");
        assert_eq!(budget.shard(4000, 1376, 0.01), 1376, "few packets");
        assert_eq!(budget.shard(200_000, 1376, 0.01), 1376, "many packets");
        assert_eq!(Budget::new(Repair::Off, 15).shard(16_080, 1376, 0.01), 1376);
    }

    #[test]
    fn repair_that_is_always_on_expects_losses_where_there_are_none() {
        assert_eq!(Budget::new(Repair::On, 15).spend(15 * 1136, 1136, 0.0), 2);
        assert_eq!(Budget::new(Repair::On, 0).spend(15 * 1136, 1136, 0.0), 0);
    }

    #[test]
    fn how_many_are_lost_is_binomial() {
        assert!((more_lost_than(0, 10, 0.1) - (1.0 - 0.9f64.powi(10))).abs() < 1e-12);
        let two = 1.0 - 0.9f64.powi(3) - 3.0 * 0.1 * 0.81;
        assert!((more_lost_than(1, 3, 0.1) - two).abs() < 1e-12);
        assert_eq!((needed(15, 0.01), needed(15, 0.002), needed(64, 0.5)), (2, 1, MOST));
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
