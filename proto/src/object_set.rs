//! Sets of a scene's objects.

use std::ops::Range;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A set of objects, by their numbers in the scene. A run of numbers takes no more room than a single one.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(try_from = "Vec<(u32, u32)>", into = "Vec<(u32, u32)>")]
pub struct ObjectSet {
    /// Ascending, none of them empty, none touching the next.
    runs: Vec<Range<u32>>,
}

/// A set of objects that was read exceeds the largest number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a set of objects is empty in places, or goes beyond number 4294967295")]
pub struct ObjectSetError;

impl ObjectSet {
    /// Whether the set contains the object.
    #[must_use]
    pub fn contains(&self, object: u32) -> bool {
        let later = self.runs.partition_point(|run| run.end <= object);
        self.runs.get(later).is_some_and(|run| run.contains(&object))
    }

    /// Whether the set is empty.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// The object with the largest number.
    #[must_use]
    pub fn last(&self) -> Option<u32> {
        self.runs.last().map(|run| run.end - 1)
    }

    /// The number of objects.
    #[must_use]
    pub fn len(&self) -> usize {
        self.runs.iter().map(ExactSizeIterator::len).sum()
    }

    /// The runs of numbers, ascending; none is empty, and none touches the next.
    #[must_use]
    pub fn runs(&self) -> &[Range<u32>] {
        &self.runs
    }

    /// The objects, ascending.
    pub fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.runs.iter().cloned().flatten()
    }
}

impl FromIterator<u32> for ObjectSet {
    fn from_iter<T: IntoIterator<Item = u32>>(objects: T) -> Self {
        let mut sorted: Vec<u32> = objects.into_iter().filter(|object| *object < u32::MAX).collect();
        sorted.sort_unstable();
        let mut runs: Vec<Range<u32>> = Vec::new();
        for object in sorted {
            match runs.last_mut().filter(|run| run.end >= object) {
                Some(run) => run.end = object + 1,
                None => runs.push(object..object + 1),
            }
        }
        Self { runs }
    }
}

/// As gaps and lengths. A gap counts from the lowest possible start of the run; a length is one less than the
/// run's.
impl TryFrom<Vec<(u32, u32)>> for ObjectSet {
    type Error = ObjectSetError;

    fn try_from(coded: Vec<(u32, u32)>) -> Result<Self, ObjectSetError> {
        let mut runs: Vec<Range<u32>> = Vec::with_capacity(coded.len());
        for (gap, more) in coded {
            let least = runs.last().map_or(Some(0), |run| run.end.checked_add(1));
            let start = least.and_then(|least| least.checked_add(gap)).ok_or(ObjectSetError)?;
            let end = start.checked_add(more).and_then(|last| last.checked_add(1)).ok_or(ObjectSetError)?;
            runs.push(start..end);
        }
        Ok(Self { runs })
    }
}

impl From<ObjectSet> for Vec<(u32, u32)> {
    fn from(set: ObjectSet) -> Self {
        let before = std::iter::once(0).chain(set.runs.iter().map(|run| run.end + 1));
        set.runs.iter().zip(before).map(|(run, least)| (run.start - least, run.end - run.start - 1)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_has_each_object_once_and_runs_are_short() {
        let set: ObjectSet = [7, 3, 4, 5, 3, 100, 6].into_iter().collect();
        assert_eq!(set.iter().collect::<Vec<_>>(), [3, 4, 5, 6, 7, 100]);
        assert_eq!((set.len(), set.is_empty(), set.last()), (6, false, Some(100)));
        assert_eq!(set.runs(), [3..8, 100..101]);
        assert_eq!(ObjectSet::default().last(), None);
        assert_eq!(Vec::from(set.clone()), [(3, 4), (91, 0)]);
        for object in 0..120 {
            assert_eq!(set.contains(object), (3..=7).contains(&object) || object == 100, "{object}");
        }
        let all: ObjectSet = (0..1_000_000).collect();
        assert!(postcard::to_stdvec(&all).unwrap().len() < 8);
    }

    #[test]
    fn what_goes_beyond_the_last_number_does_not_decode() {
        for coded in [vec![(u32::MAX, 0)], vec![(0, u32::MAX)], vec![(u32::MAX - 1, 0), (0, 0)]] {
            assert_eq!(ObjectSet::try_from(coded), Err(ObjectSetError));
        }
        let last = ObjectSet::try_from(vec![(u32::MAX - 1, 0)]).unwrap();
        assert_eq!(last.iter().collect::<Vec<_>>(), [u32::MAX - 1]);
        assert_eq!([u32::MAX].into_iter().collect::<ObjectSet>(), ObjectSet::default());
    }
}
