//! How many bytes of blocks may be under way, so that cameras and ids do not wait behind them.

use std::{collections::VecDeque, time::Duration};

use trimaran_transport::Instant;

/// How long blocks may wait in queues on the way.
const TARGET: Duration = Duration::from_millis(10);
/// The least that may be under way: two blocks.
const LEAST: u64 = 32 << 10;
/// What may be under way at first.
const FIRST: u64 = 64 << 10;
/// The most.
const MOST: u64 = 8 << 20;
/// How long the shortest time that a block took is remembered, twice over: paths change.
const REMEMBERED: Duration = Duration::from_secs(30);

/// A window after LEDBAT (RFC 6817): what blocks take longer than the fastest one did, they spent in queues.
/// Below [`TARGET`] the window grows, above it shrinks.
#[derive(Debug)]
pub(super) struct Window {
    size: u64,
    /// Whether nothing has ever waited: the window doubles each round trip until then.
    is_starting: bool,
    /// Bytes sent, and of these taken by the peer.
    sent: u64,
    taken: u64,
    /// Where blocks that are under way end, and when they were sent.
    under_way: VecDeque<(u64, Instant)>,
    /// The shortest time a block took, in this stretch of time and the one before.
    shortest: [Duration; 2],
    stretch_began: Option<Instant>,
}

/// The peer says that it has taken what was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotSent;

impl Window {
    pub(super) const fn new() -> Self {
        Self {
            size: FIRST,
            is_starting: true,
            sent: 0,
            taken: 0,
            under_way: VecDeque::new(),
            shortest: [Duration::MAX; 2],
            stretch_began: None,
        }
    }

    /// Bytes sent so far.
    pub(super) const fn sent(&self) -> u64 {
        self.sent
    }

    pub(super) const fn has_room(&self) -> bool {
        self.sent - self.taken < self.size
    }

    /// Whether next to nothing is under way.
    pub(super) const fn is_quiet(&self) -> bool {
        self.sent - self.taken < LEAST
    }

    pub(super) fn send(&mut self, bytes: u64, now: Instant) {
        self.sent += bytes;
        self.under_way.push_back((self.sent, now));
    }

    /// The peer has taken so many bytes in all.
    pub(super) fn take(&mut self, taken: u64, now: Instant) -> Result<(), NotSent> {
        if taken > self.sent {
            return Err(NotSent);
        }
        let fresh = taken.saturating_sub(self.taken);
        let was_full = self.sent - self.taken + (16 << 10) >= self.size;
        self.taken = self.taken.max(taken);
        let mut took = None;
        while let Some((end, at)) = self.under_way.front().copied().filter(|(end, _)| *end <= self.taken) {
            debug_assert!(end <= self.sent);
            took = Some(now.since(at));
            self.under_way.pop_front();
        }
        if let Some(took) = took {
            self.note(took, now);
            self.resize(took.saturating_sub(self.least()), fresh, was_full);
        }
        Ok(())
    }

    fn least(&self) -> Duration {
        self.shortest[0].min(self.shortest[1])
    }

    fn note(&mut self, took: Duration, now: Instant) {
        let began = *self.stretch_began.get_or_insert(now);
        if now.since(began) > REMEMBERED {
            self.stretch_began = Some(now);
            self.shortest = [took, self.shortest[0]];
        }
        self.shortest[0] = self.shortest[0].min(took);
    }

    fn resize(&mut self, waited: Duration, fresh: u64, was_full: bool) {
        let (waited, target) = (waited.as_secs_f64(), TARGET.as_secs_f64());
        self.is_starting &= waited <= target / 2.0;
        let fresh = fresh as f64;
        let change = if waited > target {
            // By half a window a round trip at most.
            -fresh * (0.5 * (waited / target - 1.0)).min(0.5)
        } else if !was_full {
            0.0
        } else if self.is_starting {
            fresh
        } else {
            // By two blocks a round trip at most.
            (1.0 - waited / target) * fresh * LEAST as f64 / self.size as f64
        };
        self.size = ((self.size as f64 + change) as u64).clamp(LEAST, MOST);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLOCK: u64 = 16 << 10;

    /// Sends for so long over a line of so many bytes a second, a round trip of `rtt` and a queue without
    /// bounds. Gives bytes taken, and how long blocks waited at last.
    fn over(line: f64, rtt: f64, seconds: f64) -> (u64, f64) {
        let at = |seconds: f64| Instant::from_nanos((seconds * 1e9) as u64);
        let (mut window, mut now, mut free, mut taken, mut waited) =
            (Window::new(), 0.0_f64, 0.0_f64, 0, 0.0);
        let mut arrivals = VecDeque::new();
        while now < seconds {
            while window.has_room() {
                window.send(BLOCK, at(now));
                waited = (free - now).max(0.0);
                free = free.max(now) + BLOCK as f64 / line;
                arrivals.push_back(free + rtt);
            }
            now = arrivals.pop_front().unwrap();
            taken += BLOCK;
            window.take(taken, at(now)).unwrap();
        }
        (taken, waited)
    }

    #[test]
    fn a_line_is_filled_and_its_queue_stays_short() {
        for (megabits, rtt) in [(10.0, 0.01), (100.0, 0.04), (100.0, 0.002), (1000.0, 0.04)] {
            let line = megabits * 1e6 / 8.0;
            let (taken, waited) = over(line, rtt, 20.0);
            assert!(taken as f64 > 0.8 * line * 20.0, "{megabits} Mbit/s, {rtt} s: {taken} bytes");
            // The least window may take longer than the target on a slow line.
            let least = LEAST as f64 / line;
            assert!(waited < 0.02 + least, "{megabits} Mbit/s, {rtt} s: a block waited {waited} s");
        }
    }

    #[test]
    fn what_was_not_sent_cannot_be_taken() {
        let mut window = Window::new();
        window.send(BLOCK, Instant::from_nanos(0));
        assert_eq!(window.take(BLOCK + 1, Instant::from_nanos(1)), Err(NotSent));
        assert_eq!(window.take(BLOCK, Instant::from_nanos(1)), Ok(()));
    }

    #[test]
    fn a_window_that_is_full_waits_for_the_peer() {
        let mut window = Window::new();
        let mut blocks = 0;
        while window.has_room() {
            window.send(BLOCK, Instant::from_nanos(0));
            blocks += 1;
        }
        assert_eq!(blocks, FIRST / BLOCK);
        window.take(BLOCK, Instant::from_nanos(1_000_000)).unwrap();
        assert!(window.has_room());
    }
}
