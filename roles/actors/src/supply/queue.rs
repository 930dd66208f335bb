//! The order in which drawables are sent.

use std::{
    cmp::Reverse,
    collections::{BinaryHeap, HashMap, HashSet},
};

use trimaran_proto::{DrawableId, FrameNumber};

/// The purpose of sending a drawable. Later variants are sent first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Purpose {
    /// A frame shows it.
    Shows,
    /// It stands in for finer ones until these have come.
    StandsIn,
}

/// How many stale entries may be in the order before it is rebuilt.
const STALE: usize = 1_024;

/// Drawables to be sent: stand-ins first, and for each purpose those that look largest.
#[derive(Debug, Default)]
pub(super) struct Queue {
    /// The last frame that needs each.
    due: HashMap<DrawableId, FrameNumber>,
    /// May contain duplicates, and entries that are not due any more.
    order: BinaryHeap<Entry>,
    shown: Option<FrameNumber>,
}

/// Ordered by its fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    purpose: Purpose,
    /// The bits of its apparent size: they are in the order of non-negative numbers.
    size: u64,
    id: Reverse<DrawableId>,
}

impl Queue {
    /// A frame needs it. Returns false, and keeps the order, if it is due already.
    pub(super) fn renew(&mut self, id: DrawableId, frame: FrameNumber) -> bool {
        let Some(needed) = self.due.get_mut(&id) else { return false };
        *needed = frame.max(*needed);
        true
    }

    /// Adds one of about this size on the screen, squared. One that is due already may move forward.
    pub(super) fn push(&mut self, id: DrawableId, frame: FrameNumber, purpose: Purpose, size: f64) {
        if !self.renew(id, frame) {
            self.due.insert(id, frame);
        }
        self.order.push(Entry { purpose, size: size.to_bits(), id: Reverse(id) });
        if self.order.len() > 2 * self.due.len() + STALE {
            self.forget_stale();
        }
    }

    /// Takes the next one.
    pub(super) fn pop(&mut self) -> Option<DrawableId> {
        self.purpose()?;
        let Entry { id: Reverse(id), .. } = self.order.pop()?;
        self.due.remove(&id);
        Some(id)
    }

    /// The purpose of the next one. Drops entries needed only by frames already shown.
    pub(super) fn purpose(&mut self) -> Option<Purpose> {
        while let Some(Entry { id: Reverse(id), purpose, .. }) = self.order.peek() {
            if self.due.get(id).is_some_and(|frame| Some(*frame) > self.shown) {
                return Some(*purpose);
            }
            self.due.remove(id);
            self.order.pop();
        }
        None
    }

    /// This frame, and all before it, need nothing more.
    pub(super) fn shown(&mut self, frame: FrameNumber) {
        self.shown = self.shown.max(Some(frame));
    }

    /// Drops entries that are not due any more, and all but the first entry of each drawable.
    fn forget_stale(&mut self) {
        let mut seen = HashSet::new();
        let sorted = std::mem::take(&mut self.order).into_sorted_vec();
        let first = sorted.into_iter().rev().filter(|entry| self.due.contains_key(&entry.id.0));
        self.order = first.filter(|entry| seen.insert(entry.id)).collect();
    }

    pub(super) fn clear(&mut self) {
        self.due.clear();
        self.order.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_in_comes_first_then_what_is_largest_and_each_once() {
        let mut queue = Queue::default();
        for (id, purpose, size) in [
            (1, Purpose::Shows, 9.0),
            (2, Purpose::StandsIn, 1.0),
            (3, Purpose::Shows, 99.0),
            (1, Purpose::StandsIn, 5.0),
            (4, Purpose::StandsIn, 1.0),
        ] {
            queue.push(DrawableId(id), FrameNumber(0), purpose, size);
        }
        let order: Vec<_> = std::iter::from_fn(|| queue.pop()).map(|id| id.0).collect();
        assert_eq!(order, [1, 2, 4, 3]);
    }

    /// Repeated requests of a display make at most two entries.
    #[test]
    fn the_order_is_no_longer_than_what_is_due() {
        let mut queue = Queue::default();
        for _ in 0..5_000 {
            queue.push(DrawableId(1), FrameNumber(1), Purpose::StandsIn, 1.0);
            queue.push(DrawableId(2), FrameNumber(1), Purpose::Shows, 7.0);
            queue.push(DrawableId(2), FrameNumber(1), Purpose::StandsIn, 9.0);
            assert_eq!(queue.pop(), Some(DrawableId(2)));
        }
        assert!(queue.order.len() <= 4 + STALE, "{}", queue.order.len());
        assert_eq!((queue.pop(), queue.pop()), (Some(DrawableId(1)), None));
    }

    #[test]
    fn what_only_shown_frames_needed_is_left_out() {
        let mut queue = Queue::default();
        for id in 0..4 {
            queue.push(DrawableId(id), FrameNumber(id), Purpose::Shows, 1.0);
        }
        assert!(queue.renew(DrawableId(0), FrameNumber(7)));
        assert!(!queue.renew(DrawableId(9), FrameNumber(7)));
        queue.shown(FrameNumber(2));
        let order: Vec<_> = std::iter::from_fn(|| queue.pop()).map(|id| id.0).collect();
        assert_eq!(order, [0, 3]);
    }
}
