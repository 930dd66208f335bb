//! Skipped packet numbers, which detect a peer that acknowledges packets it did not receive (RFC 9000,
//! section 21.4).

use std::collections::VecDeque;

use zeroize::Zeroizing;

use crate::packet::PacketNumber;
use crate::ranges::RangeSet;

/// The first number is skipped among about so many packets; later ones ever more rarely, up to one in 16,384.
const FIRST: u64 = 64;
const DOUBLINGS: u32 = 8;
/// How many of them are remembered: older ones are no longer acknowledged.
const REMEMBERED: usize = 8;

/// Chooses the numbers; without a secret, none.
#[derive(Default)]
pub(super) struct Skipped {
    secret: Option<Zeroizing<[u8; 32]>>,
    next: PacketNumber,
    count: u32,
    last: VecDeque<PacketNumber>,
}

impl Skipped {
    /// Chooses by 32 random bytes unknown to the peer, from `from` on.
    pub(super) fn new(secret: [u8; 32], from: PacketNumber) -> Self {
        let mut skipped = Self { secret: Some(secret.into()), ..Self::default() };
        skipped.choose(from);
        skipped
    }

    fn choose(&mut self, from: PacketNumber) {
        let Some(secret) = &self.secret else { return };
        let hash = blake3::keyed_hash(secret, &self.count.to_le_bytes());
        let drawn = hash.as_bytes().first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        self.next = from + 1 + drawn % (FIRST << self.count.min(DOUBLINGS));
        self.count = self.count.saturating_add(1);
    }

    /// Whether `number`, the next one, is skipped; asked once for each number.
    pub(super) fn leaves_out(&mut self, number: PacketNumber) -> bool {
        if self.secret.is_none() || number < self.next {
            return false;
        }
        self.last.push_back(number);
        if self.last.len() > REMEMBERED {
            self.last.pop_front();
        }
        self.choose(number);
        true
    }

    /// Whether a skipped number is among `numbers`.
    pub(super) fn is_in(&self, numbers: &RangeSet) -> bool {
        self.last.iter().any(|number| numbers.contains(*number))
    }

    /// The number of skipped ones.
    pub(super) const fn count(&self) -> u64 {
        (self.count as u64).saturating_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn left_out(secret: u8, numbers: u64) -> Vec<u64> {
        let mut skipped = Skipped::new([secret; 32], 0);
        (0..numbers).filter(|number| skipped.leaves_out(*number)).collect()
    }

    #[test]
    fn numbers_are_left_out_ever_more_rarely_and_nobody_knows_which() {
        let first = left_out(1, 100_000);
        assert!((10..60).contains(&first.len()), "{first:?}");
        assert!(first[0] <= FIRST && first.windows(2).all(|pair| pair[0] + 1 < pair[1]), "{first:?}");
        assert_ne!(first, left_out(2, 100_000));
        let mut none = Skipped::default();
        assert!((0..1000).all(|number| !none.leaves_out(number)), "without a secret");
    }

    #[test]
    fn any_of_the_next_64_may_be_the_first_and_the_last_eight_are_remembered() {
        let first: BTreeSet<_> = (0..=255).map(|secret| left_out(secret, 100)[0]).collect();
        assert_eq!((first.first(), first.last()), (Some(&1), Some(&FIRST)));
        let mut skipped = Skipped::new([1; 32], 0);
        let numbers: Vec<_> = (0..100_000).filter(|number| skipped.leaves_out(*number)).collect();
        let is_remembered = |number: &u64| {
            let mut set = RangeSet::default();
            set.insert(*number..number + 1);
            skipped.is_in(&set)
        };
        let (before, last) = numbers.split_at(numbers.len() - REMEMBERED);
        assert!(last.iter().all(is_remembered) && !before.iter().any(is_remembered), "{numbers:?}");
    }
}
