//! Sets of numbers as ranges: packets received, bytes acknowledged.

use std::collections::BTreeMap;
use std::ops::Range;

/// Disjoint, non-empty, non-adjacent half-open ranges in rising order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct RangeSet(BTreeMap<u64, u64>);

impl RangeSet {
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// How many ranges.
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = Range<u64>> + '_ {
        self.0.iter().map(|(&start, &end)| start..end)
    }

    pub(crate) fn contains(&self, value: u64) -> bool {
        self.0.range(..=value).next_back().is_some_and(|(_, &end)| value < end)
    }

    /// Where the range that holds `from` ends; `from` where none does.
    pub(crate) fn end_of_run(&self, from: u64) -> u64 {
        self.0.range(..=from).next_back().map_or(from, |(_, &end)| end.max(from))
    }

    pub(crate) fn insert(&mut self, mut range: Range<u64>) {
        if range.is_empty() {
            return;
        }
        while let Some((&start, &end)) = self.0.range(..=range.end).next_back()
            && end >= range.start
        {
            self.0.remove(&start);
            range = range.start.min(start)..range.end.max(end);
        }
        self.0.insert(range.start, range.end);
    }

    pub(crate) fn remove(&mut self, range: &Range<u64>) {
        if range.is_empty() {
            return;
        }
        while let Some((&start, &end)) = self.0.range(..range.end).next_back()
            && end > range.start
        {
            self.0.remove(&start);
            if end > range.end {
                self.0.insert(range.end, end);
            }
            if start < range.start {
                self.0.insert(start, range.start);
            }
        }
    }

    /// Takes the lowest range, or as much of it as `most` allows.
    pub(crate) fn pop_front(&mut self, most: u64) -> Option<Range<u64>> {
        let (start, end) = self.0.pop_first()?;
        let cut = end.min(start.saturating_add(most));
        if cut < end {
            self.0.insert(cut, end);
        }
        Some(start..cut)
    }

    /// The parts of `range` that are not in the set, in rising order.
    pub(crate) fn gaps(&self, range: Range<u64>) -> Vec<Range<u64>> {
        let mut rest = Self::default();
        rest.insert(range.clone());
        let from = self.0.range(..=range.start).next_back().map_or(range.start, |(&start, _)| start);
        for (&start, &end) in self.0.range(from..range.end.max(from)) {
            rest.remove(&(start..end));
        }
        rest.iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn ranges_are_a_set_of_numbers(steps in prop::collection::vec((any::<bool>(), 0u64..60, 0u64..12), 0..40)) {
            let (mut set, mut model) = (RangeSet::default(), BTreeSet::new());
            for (add, start, length) in steps {
                let range = start..start + length;
                if add {
                    set.insert(range.clone());
                    model.extend(range);
                } else {
                    set.remove(&range);
                    model.retain(|value| !range.contains(value));
                }
                let values: BTreeSet<u64> = set.iter().flatten().collect();
                prop_assert_eq!(&values, &model);
                let bounds: Vec<_> = set.iter().collect();
                prop_assert!(bounds.windows(2).all(|pair| pair[0].end < pair[1].start), "{:?}", bounds);
                for value in 0..75 {
                    prop_assert_eq!(set.contains(value), model.contains(&value));
                }
                let gaps: Vec<u64> = set.gaps(5..50).into_iter().flatten().collect();
                let missing: Vec<u64> = (5..50).filter(|value| !model.contains(value)).collect();
                prop_assert_eq!(gaps, missing);
                let run = (5..).find(|value| !model.contains(value));
                prop_assert_eq!(Some(set.end_of_run(5)), run);
            }
        }
    }

    #[test]
    fn the_front_is_taken_in_pieces() {
        let mut set = RangeSet::default();
        set.insert(3..9);
        assert_eq!(set.pop_front(4), Some(3..7));
        assert_eq!(set.pop_front(4), Some(7..9));
        assert_eq!(set.pop_front(4), None);
    }
}
