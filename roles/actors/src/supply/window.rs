//! The window of bytes in flight, so that cameras and ids do not wait behind blocks.

use std::{collections::VecDeque, time::Duration};

use trimaran_transport::Instant;

/// The target queueing delay of blocks: this long, or a quarter of the round trip.
const TARGET: Duration = Duration::from_millis(10);
/// The smallest window: two blocks.
const LEAST: u64 = 32 << 10;
/// The initial window.
const FIRST: u64 = 64 << 10;
/// The largest window.
const MOST: u64 = 8 << 20;
/// A queue must persist for this long, and for this many blocks. A single block may have waited for a display
/// that was drawing.
const STANDS: Duration = Duration::from_millis(100);
const FEWEST: u32 = 4;
/// The share of its size to which a window must shrink to tell whether the queue is its own.
const TELLING: f64 = 0.75;
/// The lifetime of the minimum delay, in two stretches: paths change.
const REMEMBERED: Duration = Duration::from_secs(30);

/// A window after LEDBAT (RFC 6817) and CoDel (RFC 8289): delay above the minimum is queueing delay. It grows
/// with each block below the target. It shrinks if all blocks of [`STANDS`] were above it.
///
/// Its own queue gets shorter when the window does. Other delay stays, such as that of a peer with a busy
/// processor: then the window doubles its former size, and that delay counts as part of the path. So does the
/// delay at the smallest window.
#[derive(Debug)]
pub(super) struct Window {
    size: u64,
    /// Slow start: the window doubles each round trip until a block has waited.
    is_starting: bool,
    /// Bytes sent, and of these acknowledged by the peer.
    sent: u64,
    taken: u64,
    /// The ends of blocks in flight, and when they were sent.
    under_way: VecDeque<(u64, Instant)>,
    /// The minimum delay of a block, in this stretch of time and the one before.
    shortest: [Duration; 2],
    stretch_began: Option<Instant>,
    standing: Standing,
    /// While the window shrinks: its size before, and the minimum delay then.
    shrunk: Option<(u64, Duration)>,
}

/// The blocks sent since a time: how many were acknowledged, and their minimum delay.
#[derive(Debug, Clone, Copy)]
struct Standing {
    since: Instant,
    blocks: u32,
    shortest: Duration,
}

/// The peer acknowledges bytes that were not sent.
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
            standing: Standing::since(Instant::from_nanos(0)),
            shrunk: None,
        }
    }

    /// Bytes sent so far.
    pub(super) const fn sent(&self) -> u64 {
        self.sent
    }

    /// Bytes that the peer has acknowledged.
    pub(super) const fn taken(&self) -> u64 {
        self.taken
    }

    pub(super) const fn has_room(&self) -> bool {
        self.sent - self.taken < self.size
    }

    /// Whether next to nothing is in flight.
    pub(super) const fn is_quiet(&self) -> bool {
        self.sent - self.taken < LEAST
    }

    pub(super) fn send(&mut self, bytes: u64, now: Instant) {
        self.sent += bytes;
        self.under_way.push_back((self.sent, now));
    }

    /// The peer acknowledges this many bytes in all.
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
            took = Some((at, now.since(at)));
            self.under_way.pop_front();
        }
        if let Some((at, took)) = took {
            self.note(took, now);
            if was_full {
                self.grow(took.saturating_sub(self.least()), fresh);
            }
            self.standing.note(at, took);
            if self.standing.is_known(now) {
                self.judge(self.standing.shortest);
                self.standing = Standing::since(now);
            }
        }
        Ok(())
    }

    fn least(&self) -> Duration {
        self.shortest[0].min(self.shortest[1])
    }

    fn target(&self) -> Duration {
        TARGET.max(self.least() / 4)
    }

    fn note(&mut self, took: Duration, now: Instant) {
        let began = *self.stretch_began.get_or_insert(now);
        if now.since(began) > REMEMBERED {
            self.stretch_began = Some(now);
            self.shortest = [took, self.shortest[0]];
        }
        self.shortest[0] = self.shortest[0].min(took);
    }

    /// A block was delayed for this long, and brought this many bytes.
    fn grow(&mut self, waited: Duration, fresh: u64) {
        let (waited, target) = (waited.as_secs_f64(), self.target().as_secs_f64());
        let fresh = fresh as f64;
        let change = if !self.is_starting {
            // By at most a quarter per round trip.
            (1.0 - waited / target).max(0.0) * fresh / 4.0
        } else if waited <= target / 2.0 {
            fresh
        } else {
            0.0
        };
        self.size = (self.size + change as u64).min(MOST);
    }

    /// Every recent block took at least this long.
    fn judge(&mut self, took: Duration) {
        let waited = took.saturating_sub(self.least());
        let over = waited.as_secs_f64() / self.target().as_secs_f64() - 1.0;
        self.is_starting &= over <= -0.5;
        if over <= 0.0 {
            self.shrunk = None;
            return;
        }
        let (size, before) = *self.shrunk.get_or_insert((self.size, took));
        let share = self.size as f64 / size as f64;
        if share <= TELLING {
            self.shrunk = None;
            // On a saturated line the delay falls in proportion to the bytes in flight.
            if took > before.mul_f64(f64::midpoint(1.0, share)) {
                self.size = (2 * size).min(MOST);
                self.shortest = [took; 2];
                return;
            }
        } else if self.size == LEAST {
            // At the minimum it cannot shrink to tell, and makes no long queue.
            self.shrunk = None;
            self.shortest = [took; 2];
            return;
        }
        // By at most half.
        let kept = 1.0 - (0.5 * over).min(0.5);
        self.size = ((self.size as f64 * kept) as u64).max(LEAST);
    }
}

impl Standing {
    const fn since(since: Instant) -> Self {
        Self { since, blocks: 0, shortest: Duration::MAX }
    }

    /// A block sent at that time took this long.
    fn note(&mut self, sent: Instant, took: Duration) {
        if sent >= self.since {
            self.blocks += 1;
            self.shortest = self.shortest.min(took);
        }
    }

    fn is_known(&self, now: Instant) -> bool {
        self.blocks >= FEWEST && now.since(self.since) >= STANDS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLOCK: u64 = 16 << 10;

    /// Sends for this long over a line of this many bytes a second, with a round trip of `rtt` and an
    /// unbounded queue. Returns the acknowledged bytes, and the final delay of blocks.
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
            // The smallest window may exceed the target delay on a slow line.
            let least = LEAST as f64 / line;
            assert!(waited < 0.02 + least, "{megabits} Mbit/s, {rtt} s: a block waited {waited} s");
        }
    }

    /// Sends for this many milliseconds to a display that draws pictures of the given duration, and receives
    /// between them all that has come. The round trip is `rtt`. Returns the bytes received.
    fn to_drawing(window: &mut Window, begin: u64, end: u64, rtt: u64, pictures: &[u64]) -> u64 {
        let at = |millis: u64| Instant::from_nanos(millis * 1_000_000);
        let (mut sent, before) = (VecDeque::new(), window.taken);
        let mut pictures = pictures.iter().cycle();
        let mut free = begin;
        for now in begin..end {
            while window.has_room() {
                window.send(BLOCK, at(now));
                sent.push_back(now);
            }
            if now == free {
                free += pictures.next().unwrap();
                let there = sent.iter().take_while(|then| now >= **then + rtt).count();
                sent.drain(..there);
                window.take(window.taken + BLOCK * there as u64, at(now)).unwrap();
            }
        }
        // Finally all bytes in flight are acknowledged.
        window.take(window.sent, at(end)).unwrap();
        window.taken - before
    }

    #[test]
    fn a_display_that_draws_meanwhile_is_no_queue() {
        let taken = to_drawing(&mut Window::new(), 0, 5000, 80, &[12, 38, 17, 52, 25]);
        assert!(taken as f64 > 20e6, "{taken} bytes in 5 s");
    }

    /// From a jump on its processor is busy: no block is received as soon as it comes any more.
    #[test]
    fn a_display_that_slows_down_is_no_queue() {
        let mut window = Window::new();
        to_drawing(&mut window, 0, 4, 2, &[1]);
        let taken = to_drawing(&mut window, 4, 5004, 2, &[55, 70, 63, 58]);
        assert!(taken as f64 > 20e6, "{taken} bytes in 5 s");
    }

    /// At the minimum it cannot shrink to tell.
    #[test]
    fn the_least_window_grows_again_where_a_display_is_slow() {
        let mut window = Window::new();
        to_drawing(&mut window, 0, 4, 2, &[1]);
        (window.size, window.is_starting) = (LEAST + 100, false);
        let taken = to_drawing(&mut window, 4, 5004, 2, &[55, 70, 63, 58]);
        assert!(taken as f64 > 10e6, "{taken} bytes in 5 s");
    }

    /// The delay falls with the window if the queue is its own, and else does not.
    #[test]
    fn a_window_whose_queue_is_not_its_own_becomes_twice_as_large_as_it_was() {
        let ms = Duration::from_millis;
        let shrunk = || {
            let mut window = Window::new();
            (window.size, window.is_starting, window.shortest) = (1 << 20, false, [ms(2); 2]);
            window.judge(ms(62));
            assert_eq!(window.size, 512 << 10);
            window
        };
        let mut window = shrunk();
        window.judge(ms(40));
        assert_eq!((window.size, window.least()), (256 << 10, ms(2)), "half the queue: it is its own");
        let mut window = shrunk();
        window.judge(ms(60));
        assert_eq!((window.size, window.least()), (2 << 20, ms(60)), "the wait counts as the way");
        window.judge(ms(65));
        assert_eq!(window.size, 2 << 20);
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
