//! A queue of events by time.

use std::collections::BTreeMap;

use trimaran_net::Instant;

/// Events in the order of their times. Events of the same nanosecond keep the order in which they were added.
#[derive(Debug)]
pub(crate) struct Events<E> {
    queue: BTreeMap<(Instant, u64), E>,
    added: u64,
}

impl<E> Events<E> {
    pub(crate) const fn new() -> Self {
        Self { queue: BTreeMap::new(), added: 0 }
    }

    pub(crate) fn add(&mut self, at: Instant, event: E) {
        self.queue.insert((at, self.added), event);
        self.added += 1;
    }

    /// The next event and its time, unless it is later than `end`.
    pub(crate) fn next_by(&mut self, end: Instant) -> Option<(Instant, E)> {
        let first = self.queue.first_entry().filter(|first| first.key().0 <= end)?;
        let ((at, _), event) = first.remove_entry();
        Some((at, event))
    }

    /// The time of the next event.
    pub(crate) fn next_at(&self) -> Option<Instant> {
        self.queue.first_key_value().map(|((at, _), _)| *at)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn events_come_by_time_and_then_in_the_order_added(times in prop::collection::vec(0_u64..20, 0..100)) {
            let mut events = Events::new();
            for (index, time) in times.iter().enumerate() {
                events.add(Instant::from_nanos(*time), index);
            }
            let mut expected: Vec<(u64, usize)> = times.iter().copied().zip(0..).collect();
            expected.sort();
            let mut got = Vec::new();
            while let Some(at) = events.next_at() {
                let (time, event) = events.next_by(at).unwrap();
                prop_assert_eq!(time, at);
                got.push((time.as_nanos(), event));
            }
            prop_assert_eq!(got, expected);
        }
    }
}
