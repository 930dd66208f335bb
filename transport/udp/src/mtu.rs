//! Path MTU discovery: 1,200 bytes, and more where a probe of that size has arrived (RFC 8899).

use std::time::Duration;

use trimaran_net::Instant;

use crate::packet::MIN_DATAGRAM;

/// How often a size is tried before it counts as too large.
const TRIES: u32 = 3;
/// The search ends when fewer bytes than this can be gained.
const ENOUGH: usize = 16;
/// The pause before the first probe: the handshake and first frames go first.
const FIRST: Duration = Duration::from_millis(100);
/// How long a search is valid: the path may change (RFC 8899, section 5.1.1).
const AGAIN: Duration = Duration::from_secs(600);
/// The pause before the next search if nothing arrives any more: it may have been a burst of losses.
const DOUBT: Duration = Duration::from_secs(1);

/// Searches for the largest datagram that arrives.
#[derive(Debug)]
pub(crate) struct Mtu {
    known: usize,
    /// The largest size that may still be tried.
    limit: usize,
    most: usize,
    tries: u32,
    /// The size of the probe in flight.
    under_way: Option<usize>,
    next: Instant,
}

impl Mtu {
    pub(crate) fn new(now: Instant, most: usize) -> Self {
        let most = most.max(MIN_DATAGRAM);
        Self { known: MIN_DATAGRAM, limit: most, most, tries: 0, under_way: None, next: now.after(FIRST) }
    }

    /// The size known to arrive.
    pub(crate) const fn known(&self) -> usize {
        self.known
    }

    /// When a probe is due.
    pub(crate) const fn due(&self) -> Option<Instant> {
        let done = self.under_way.is_some() || self.most < self.known + ENOUGH;
        if done { None } else { Some(self.next) }
    }

    /// The size of the probe to send now, if one is due.
    pub(crate) fn probe(&mut self, now: Instant) -> Option<usize> {
        self.due().filter(|due| *due <= now)?;
        if self.limit < self.known + ENOUGH {
            self.limit = self.most;
        }
        // The largest is the likeliest: most paths carry Ethernet's size.
        let size = if self.limit == self.most { self.most } else { (self.known + self.limit).div_ceil(2) };
        self.under_way = Some(size);
        Some(size)
    }

    /// A probe has arrived.
    pub(crate) fn on_arrived(&mut self, now: Instant, size: usize) {
        self.known = self.known.max(size);
        self.settle(now);
    }

    /// A probe was lost.
    pub(crate) fn on_lost(&mut self, now: Instant, size: usize) {
        self.under_way = None;
        self.tries += 1;
        if self.tries >= TRIES {
            self.limit = size - 1;
            self.settle(now);
        }
    }

    /// Nothing arrives any more: the path may have become narrower.
    pub(crate) fn on_black_hole(&mut self, now: Instant) {
        self.known = MIN_DATAGRAM;
        self.limit = self.most;
        self.under_way = None;
        self.tries = 0;
        self.next = now.after(DOUBT);
    }

    fn settle(&mut self, now: Instant) {
        self.under_way = None;
        self.tries = 0;
        let done = self.limit < self.known + ENOUGH;
        self.next = if done { now.after(AGAIN) } else { now };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Searches a path that carries `carries` bytes; returns the size found and the number of probes.
    fn search(carries: usize, most: usize) -> (usize, u32) {
        let mut now = Instant::from_nanos(0);
        let (mut mtu, mut probes) = (Mtu::new(now, most), 0);
        while let Some(due) = mtu.due().filter(|due| due.since(now) < AGAIN) {
            now = now.max(due);
            let size = mtu.probe(now).unwrap();
            assert!(size > mtu.known() && size <= most);
            assert_eq!(mtu.probe(now), None, "one at a time");
            probes += 1;
            assert!(probes <= 30, "{probes} probes");
            if size <= carries { mtu.on_arrived(now, size) } else { mtu.on_lost(now, size) }
        }
        (mtu.known(), probes)
    }

    #[test]
    fn the_largest_size_that_arrives_is_found() {
        assert_eq!(search(1500, 1452), (1452, 1));
        assert_eq!(search(1200, 1200), (1200, 0));
        for carries in [1200, 1201, 1280, 1392, 1451] {
            let found = search(carries, 1452).0;
            assert!(found <= carries && found + ENOUGH > carries, "{found} of {carries}");
        }
    }

    #[test]
    fn sixteen_bytes_are_worth_a_probe_and_fewer_are_not() {
        assert_eq!((search(1216, 1216), search(1215, 1215)), ((1216, 1), (1200, 0)));
        // The largest is tried three times, and then the middle of the range that is left.
        assert_eq!((search(1200, 1216), search(1200, 1217)), ((1200, 3), (1200, 6)));
    }

    #[test]
    fn ten_minutes_after_a_search_the_largest_size_is_tried_again() {
        let mut mtu = Mtu::new(Instant::from_nanos(0), 1216);
        let now = Instant::from_nanos(1_000_000_000);
        for _ in 0..TRIES {
            assert_eq!(mtu.probe(now), Some(1216));
            mtu.on_lost(now, 1216);
        }
        let again = now.after(AGAIN);
        assert_eq!((mtu.due(), mtu.probe(now), mtu.probe(again)), (Some(again), None, Some(1216)));
    }

    #[test]
    fn a_black_hole_starts_anew() {
        let mut mtu = Mtu::new(Instant::from_nanos(0), 1452);
        let now = Instant::from_nanos(1_000_000_000);
        mtu.probe(now);
        mtu.on_arrived(now, 1452);
        assert_eq!((mtu.known(), mtu.due()), (1452, None));
        mtu.on_black_hole(now);
        assert_eq!((mtu.known(), mtu.due()), (1200, Some(now.after(DOUBT))));
    }
}
