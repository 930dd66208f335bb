//! Sets of numbers as ranges: packets received, bytes acknowledged.

use std::ops::Range;

use smallvec::SmallVec;

/// Disjoint, non-empty, non-adjacent half-open ranges in rising order. They are few, and mostly one, which
/// needs no memory of its own.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct RangeSet(SmallVec<[Range<u64>; 2]>);

impl RangeSet {
    /// Those ranges, none of which is empty or touches another, in rising order.
    pub(crate) const fn from_rising(ranges: SmallVec<[Range<u64>; 2]>) -> Self {
        Self(ranges)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The number of ranges.
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = Range<u64>> + '_ {
        self.0.iter().cloned()
    }

    pub(crate) fn contains(&self, value: u64) -> bool {
        self.end_of_run(value) > value
    }

    /// The end of the range that holds `from`; `from` if none does.
    pub(crate) fn end_of_run(&self, from: u64) -> u64 {
        let first = self.0.partition_point(|range| range.end <= from);
        self.0.get(first).filter(|range| range.start <= from).map_or(from, |range| range.end)
    }

    /// Whether any number of `range` is in it.
    pub(crate) fn overlaps(&self, range: &Range<u64>) -> bool {
        let first = self.0.partition_point(|held| held.end <= range.start);
        self.0.get(first).is_some_and(|held| held.start < range.end)
    }

    /// The ranges that reach `from` or beyond, uncut.
    pub(crate) fn reaching_over(&self, from: u64) -> Self {
        let first = self.0.partition_point(|range| range.end <= from);
        Self(self.0.get(first..).unwrap_or_default().into())
    }

    pub(crate) fn insert(&mut self, mut range: Range<u64>) {
        if range.is_empty() {
            return;
        }
        // Ranges that it touches are merged with it.
        let from = self.0.partition_point(|other| other.end < range.start);
        let to = self.0.partition_point(|other| other.start <= range.end);
        for other in self.0.drain(from..to) {
            range = range.start.min(other.start)..range.end.max(other.end);
        }
        self.0.insert(from, range);
    }

    pub(crate) fn remove(&mut self, range: &Range<u64>) {
        if range.is_empty() {
            return;
        }
        let from = self.0.partition_point(|other| other.end <= range.start);
        let to = self.0.partition_point(|other| other.start < range.end).max(from);
        let (mut below, mut above) = (None, None);
        for other in self.0.drain(from..to) {
            below = below.or((other.start < range.start).then_some(other.start..range.start));
            above = (other.end > range.end).then_some(range.end..other.end);
        }
        self.0.insert_many(from, below.into_iter().chain(above));
    }

    /// Removes `range` from the set, and returns the part that was in it.
    pub(crate) fn take(&mut self, range: &Range<u64>) -> Self {
        let mut taken = Self::default();
        for held in self.iter() {
            taken.insert(held.start.max(range.start)..held.end.min(range.end));
        }
        self.remove(range);
        taken
    }

    /// Takes the lowest range.
    pub(crate) fn pop_front(&mut self) -> Option<Range<u64>> {
        (!self.is_empty()).then(|| self.0.remove(0))
    }

    /// The parts of `range` that are not in the set.
    pub(crate) fn gaps(&self, range: Range<u64>) -> Self {
        let mut gaps = Self::default();
        gaps.insert(range.clone());
        self.0.iter().for_each(|held| gaps.remove(held));
        gaps
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
                let gaps: Vec<u64> = set.gaps(5..50).iter().flatten().collect();
                let missing: Vec<u64> = (5..50).filter(|value| !model.contains(value)).collect();
                prop_assert_eq!(gaps, missing);
                let run = (5..).find(|value| !model.contains(value));
                prop_assert_eq!(Some(set.end_of_run(5)), run);
                let mut rest = set.clone();
                let taken: BTreeSet<u64> = rest.take(&(17..31)).iter().flatten().collect();
                let (inside, outside) = model.iter().partition::<BTreeSet<u64>, _>(|value| (17..31).contains(*value));
                prop_assert_eq!((taken, rest.iter().flatten().collect()), (inside, outside));
                prop_assert_eq!(set.overlaps(&(20..23)), (20..23).any(|value| model.contains(&value)));
                let above: Vec<_> = set.iter().filter(|range| range.end > 20).collect();
                prop_assert_eq!(set.reaching_over(20).iter().collect::<Vec<_>>(), above);
            }
        }
    }
}
