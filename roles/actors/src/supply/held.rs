//! A display's drawables, or its pieces of geometry, as known to its culler.

use std::collections::HashMap;

use fixedbitset::FixedBitSet;

/// The end of something being sent is not known yet.
const NOT_YET: u64 = u64::MAX;
/// A display's requests may be this many bytes older than its last acknowledgement.
const LATE: u64 = 16 << 20;
/// How many ends are kept before outdated ones are removed.
const FEW: usize = 4_096;

/// A set of a scene's numbers. It takes one bit per number, and more for recently sent ones.
#[derive(Debug)]
pub(super) struct Held {
    /// The ones that the display surely has.
    there: FixedBitSet,
    /// The offset in the sent bytes where each ends. The display has those up to its acknowledged bytes.
    ends: HashMap<u32, u64>,
    /// At this many ends outdated ones are removed.
    settles_at: usize,
}

impl Held {
    /// An empty set of numbers below `count`.
    pub(super) fn nothing_of(count: usize) -> Self {
        Self { there: FixedBitSet::with_capacity(count), ends: HashMap::new(), settles_at: FEW }
    }

    /// The first of these that is out of range.
    pub(super) fn stranger(&self, numbers: impl IntoIterator<Item = u32>) -> Option<u32> {
        numbers.into_iter().find(|number| *number as usize >= self.there.len())
    }

    /// The display has it.
    pub(super) fn insert(&mut self, number: u32) {
        if (number as usize) < self.there.len() {
            self.there.insert(number as usize);
            self.ends.remove(&number);
        }
    }

    /// Marks it as being sent. Returns whether it was not before.
    pub(super) fn send(&mut self, number: u32) -> bool {
        let is_new = !self.contains(number) && (number as usize) < self.there.len();
        if is_new {
            self.ends.insert(number, NOT_YET);
        }
        is_new
    }

    /// It was sent, and ends at this offset. Ignores it if it was removed meanwhile.
    pub(super) fn sent(&mut self, number: u32, end: u64) {
        if let Some(known) = self.ends.get_mut(&number) {
            *known = end;
        }
    }

    pub(super) fn remove(&mut self, number: u32) {
        self.ends.remove(&number);
        if (number as usize) < self.there.len() {
            self.there.set(number as usize, false);
        }
    }

    /// Whether the display has it, or it is on its way.
    pub(super) fn contains(&self, number: u32) -> bool {
        self.there.contains(number as usize) || self.ends.contains_key(&number)
    }

    /// Whether it had ended when the display had taken this many bytes.
    pub(super) fn had_ended(&self, number: u32, taken: u64) -> bool {
        self.there.contains(number as usize) || self.ends.get(&number).is_some_and(|end| *end <= taken)
    }

    /// Removes the ends of all that a display with this many taken bytes surely has.
    pub(super) fn settle(&mut self, taken: u64) {
        if self.ends.len() < self.settles_at {
            return;
        }
        let there = &mut self.there;
        self.ends.retain(|number, end| {
            let is_late = end.saturating_add(LATE) > taken;
            if !is_late {
                there.insert(*number as usize);
            }
            is_late
        });
        self.settles_at = FEW.max(2 * self.ends.len());
    }

    pub(super) fn clear(&mut self) {
        self.there.clear();
        self.ends = HashMap::new();
        self.settles_at = FEW;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_is_there_once_the_display_has_taken_it() {
        let mut held = Held::nothing_of(9);
        held.insert(1);
        assert!(held.send(2) && !held.send(2) && !held.send(1));
        assert!(held.contains(2) && !held.had_ended(2, u64::MAX - 1), "it is on its way");
        held.sent(2, 500);
        assert_eq!([499, 500].map(|taken| held.had_ended(2, taken)), [false, true]);
        assert!(held.had_ended(1, 0), "the display had it");
        held.remove(2);
        held.sent(2, 600);
        assert!(!held.contains(2), "it was thrown away meanwhile");
        held.remove(1);
        assert!(!held.contains(1));
        held.clear();
        assert!(held.send(1));
    }

    #[test]
    fn only_what_was_sent_lately_takes_more_than_a_bit() {
        const COUNT: u32 = 1_000_000;
        let mut held = Held::nothing_of(COUNT as usize);
        for number in 0..COUNT {
            assert!(held.send(number));
            let end = u64::from(number) * 1_000;
            held.sent(number, end);
            held.settle(end);
        }
        assert!(held.ends.len() <= 2 * (LATE as usize / 1_000) + FEW, "{}", held.ends.len());
        assert!((0..COUNT).all(|number| held.contains(number)));
        assert!(!held.had_ended(COUNT - 1, 0));
    }

    /// Numbers that the scene lacks are never contained, and take no memory.
    #[test]
    fn other_numbers_are_strangers() {
        let mut held = Held::nothing_of(3);
        assert_eq!(held.stranger([0, 2]), None);
        assert_eq!(held.stranger([0, 3, 9]), Some(3));
        held.insert(3);
        assert!(!held.send(u32::MAX) && !held.contains(3) && held.ends.is_empty());
        held.remove(3);
        assert!(!held.had_ended(3, u64::MAX));
    }
}
