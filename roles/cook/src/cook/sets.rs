//! Sets of numbers that are joined one by one: union-find.

use crate::lists::put;

/// Each number points to a lower one of its set, or to itself.
pub(super) struct Sets(Vec<u32>);

impl Sets {
    /// The numbers up to `count`, each in a set of its own.
    pub(super) fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The lowest number of a number's set. Halves the path for later calls.
    pub(super) fn first(&mut self, mut number: u32) -> u32 {
        while let Some(&next) = self.0.get(number as usize).filter(|next| **next != number) {
            let after = self.0.get(next as usize).copied().unwrap_or(next);
            put(&mut self.0, number, after);
            number = after;
        }
        number
    }

    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.first(a), self.first(b));
        put(&mut self.0, a.max(b), a.min(b));
    }
}
