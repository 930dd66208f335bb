//! The open handshakes at a listener: their limit, and which of them gives way to a new one.

use parking_lot::Mutex;
use std::convert::Infallible;
use std::sync::Arc;

use tokio::sync::oneshot;

use crate::rates::Origin;

/// A slot for each open handshake. None of their peers is authenticated yet, so a new handshake always gets a
/// slot.
///
/// If all are taken, an origin that holds more of them than a link takes gives way first, and among equals
/// the oldest handshake. So a flood displaces itself, and peers that share its address have as long as the
/// flood takes to fill all slots.
#[derive(Debug)]
pub(crate) struct Pending {
    slots: Arc<Mutex<Slots>>,
}

#[derive(Debug, Default)]
struct Slots {
    /// Those of one link: over byte streams each of its connections shakes hands.
    of_a_link: usize,
    next: u64,
    /// The oldest first.
    taken: Vec<Taken>,
}

#[derive(Debug)]
struct Taken {
    number: u64,
    origin: Origin,
    /// Dropped to tell the handshake that it has lost its slot.
    _revoke: oneshot::Sender<Infallible>,
}

/// A handshake's slot, free again when this is dropped.
#[derive(Debug)]
pub struct Slot {
    number: u64,
    slots: Arc<Mutex<Slots>>,
    revoked: oneshot::Receiver<Infallible>,
}

impl Pending {
    /// A link takes `of_a_link` at once.
    pub(crate) fn new(of_a_link: usize) -> Self {
        let slots = Slots { of_a_link, ..Slots::default() };
        Self { slots: Arc::new(Mutex::new(slots)) }
    }

    /// A slot for a handshake of `origin`, and whether another handshake lost its slot for it: at most `most`
    /// have one at once, and at least one.
    pub(crate) fn take(&self, origin: Origin, most: usize) -> (Slot, bool) {
        let mut slots = self.slots.lock();
        let full = slots.taken.len() >= most.max(1);
        while slots.taken.len() >= most.max(1) {
            slots.evict();
        }
        let (number, (_revoke, revoked)) = (slots.next, oneshot::channel());
        slots.next += 1;
        slots.taken.push(Taken { number, origin, _revoke });
        (Slot { number, slots: Arc::clone(&self.slots), revoked }, full)
    }
}

impl Slots {
    fn evict(&mut self) {
        let excess = |taken: &Taken| {
            let held = self.taken.iter().filter(|other| other.origin == taken.origin).count();
            held.saturating_sub(self.of_a_link)
        };
        // Of equals the last one is found, which here is the oldest.
        let victim = self.taken.iter().enumerate().rev().max_by_key(|(_, taken)| excess(taken));
        if let Some((index, _)) = victim {
            self.taken.remove(index);
        }
    }
}

impl Slot {
    /// Ends once the slot has been given to another handshake.
    pub async fn revoked(&mut self) {
        let Err(_) = (&mut self.revoked).await;
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.slots.lock().taken.retain(|taken| taken.number != self.number);
    }
}

#[cfg(test)]
mod tests {
    use std::net::IpAddr;
    use std::pin::pin;
    use std::task::{Context, Waker};

    use super::*;

    fn origin(last: u8) -> Origin {
        Origin::Network(IpAddr::from([10, 0, 0, last]))
    }

    fn is_revoked(slot: &mut Slot) -> bool {
        pin!(slot.revoked()).poll(&mut Context::from_waker(Waker::noop())).is_ready()
    }

    /// Takes a slot for each of `origins`; returns the indices of those that still have one in the end.
    fn survivors(most: usize, origins: &[u8]) -> Vec<usize> {
        let pending = Pending::new(4);
        let mut slots: Vec<Slot> = origins.iter().map(|last| pending.take(origin(*last), most).0).collect();
        (0..slots.len()).filter(|index| !is_revoked(&mut slots[*index])).collect()
    }

    #[test]
    fn who_comes_last_has_a_slot_and_an_address_with_many_gives_way_by_its_oldest() {
        assert_eq!(survivors(4, &[1, 1, 1, 1]), [0, 1, 2, 3], "there is room");
        assert_eq!(survivors(6, &[2, 1, 1, 1, 1, 1, 1]), [0, 2, 3, 4, 5, 6], "1 has five");
        assert_eq!(survivors(6, &[1, 1, 1, 1, 1, 2, 2, 2]), [2, 3, 4, 5, 6, 7], "1 had more than 2");
        assert_eq!(survivors(3, &[1, 2, 3, 4, 5]), [2, 3, 4], "all have one");
    }

    #[test]
    fn a_link_of_four_connections_is_no_crowd_among_single_ones() {
        assert_eq!(
            survivors(6, &[2, 3, 1, 1, 1, 1, 4]),
            [1, 2, 3, 4, 5, 6],
            "the oldest, not one of 1's four"
        );
        assert_eq!(
            survivors(7, &[1, 1, 2, 2, 2, 2, 2, 3]),
            [0, 1, 3, 4, 5, 6, 7],
            "five are more than a link takes"
        );
    }

    #[test]
    fn a_slot_is_free_once_it_is_dropped() {
        let pending = Pending::new(4);
        let (first, evicted) = pending.take(origin(1), 1);
        assert!(!evicted);
        drop(first);
        let (mut second, evicted) = pending.take(origin(2), 1);
        assert!(!evicted && !is_revoked(&mut second));
        let (mut third, evicted) = pending.take(origin(3), 1);
        assert!(evicted && is_revoked(&mut second) && !is_revoked(&mut third));
        drop(second);
        assert!(!is_revoked(&mut third), "who has lost its slot frees none");
        assert!(pending.take(origin(4), 1).1);
    }

    #[test]
    fn there_is_one_slot_at_least() {
        let (mut slot, _) = Pending::new(4).take(origin(1), 0);
        assert!(!is_revoked(&mut slot));
    }
}
