//! Spreads packets over the round trip (RFC 9002, section 7.7).

use std::time::Duration;

use trimaran_net::Instant;

/// The largest burst, in packets: the initial window of RFC 9002.
const BURST: usize = 10;
/// Added to it are packets due before a timer can ring, which is as coarse as a millisecond and one late.
const TICK: Duration = Duration::from_millis(2);
/// The largest burst with these, in packets.
const LARGEST: usize = 128;

/// A bucket of bytes that fills at 5/4 of the window a round trip.
#[derive(Debug)]
pub(crate) struct Pacer {
    tokens: f64,
    filled: Option<Instant>,
    segment: usize,
}

impl Pacer {
    pub(crate) const fn new(segment: usize) -> Self {
        Self { tokens: (BURST * segment) as f64, filled: None, segment }
    }

    /// Packets have another size from now on.
    pub(crate) const fn set_segment(&mut self, segment: usize) {
        self.segment = segment;
    }

    /// When a full packet may leave: not after `now` if at once. A waiting packet was to leave at `due`.
    ///
    /// On a busy machine timers ring late. Packets due by then leave at once. Otherwise a sender that runs
    /// rarely could send only one burst each time, however wide the path is.
    pub(crate) fn ready(
        &mut self,
        now: Instant,
        due: Option<Instant>,
        window: usize,
        rtt: Duration,
    ) -> Instant {
        let rate = 1.25 * window as f64 / rtt.as_secs_f64().max(1e-6);
        let waited = self.filled.map_or(Duration::ZERO, |filled| now.since(filled));
        if !waited.is_zero() {
            let held_up = due.map_or(Duration::ZERO, |due| now.since(due));
            let full = ((BURST * self.segment) as f64 + rate * TICK.as_secs_f64())
                .max(rate * held_up.as_secs_f64())
                .min((LARGEST * self.segment) as f64);
            self.tokens = (self.tokens + rate * waited.as_secs_f64()).min(full);
        }
        self.filled = Some(now);
        let missing = self.segment as f64 - self.tokens;
        // A fraction of a byte is rounding.
        if missing < 1.0 { now } else { now.after(Duration::from_secs_f64((missing / rate).max(1e-9))) }
    }

    pub(crate) fn on_sent(&mut self, bytes: usize) {
        self.tokens -= bytes as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many packets of 1,000 bytes leave at once, `idle` after the first look.
    fn burst(idle: Duration, window: usize, rtt: Duration) -> usize {
        let mut pacer = Pacer::new(1000);
        let start = Instant::from_nanos(0);
        pacer.ready(start, None, window, rtt);
        let now = start.after(idle);
        let leaves = |pacer: &mut Pacer| {
            let ready = pacer.ready(now, None, window, rtt) == now;
            pacer.on_sent(1000);
            ready
        };
        (0..).find(|_| !leaves(&mut pacer)).unwrap()
    }

    #[test]
    fn ten_packets_leave_at_once_at_first_and_then_one_after_the_other() {
        let mut pacer = Pacer::new(1000);
        let (start, rtt) = (Instant::from_nanos(0), Duration::from_millis(10));
        for _ in 0..10 {
            assert_eq!(pacer.ready(start, None, 20_000, rtt), start);
            pacer.on_sent(1000);
        }
        // 25,000 bytes in 10 ms: 0.4 ms a packet.
        let next = pacer.ready(start, None, 20_000, rtt);
        assert_eq!(next.since(start).as_micros(), 400);
        assert_eq!(pacer.ready(next, Some(next), 20_000, rtt), next);
        pacer.on_sent(1000);
        pacer.set_segment(2000);
        let after = pacer.ready(next, None, 20_000, rtt);
        assert_eq!(after.since(next).as_micros(), 800, "a packet is larger now");
    }

    #[test]
    fn a_missing_byte_is_waited_for_and_a_fraction_of_one_is_not() {
        let (start, rtt) = (Instant::from_nanos(0), Duration::from_millis(10));
        for (sent, window, nanos) in [(9_000, 20_000, 0), (9_001, 20_000, 400), (9_001, 8_000, 1_000)] {
            let mut pacer = Pacer::new(1000);
            pacer.on_sent(sent);
            assert_eq!(pacer.ready(start, None, window, rtt).since(start).as_nanos(), nanos);
        }
        let mut pacer = Pacer::new(1000);
        pacer.on_sent(9_001);
        pacer.ready(start, None, 20_000, rtt);
        let almost = start.after(Duration::from_nanos(1));
        assert_eq!(pacer.ready(almost, None, 20_000, rtt), almost, "0.9975 of it is missing");
    }

    #[test]
    fn what_a_timer_would_make_late_leaves_with_them() {
        let (idle, ms) = (Duration::from_secs(1), Duration::from_millis(1));
        // 2.5 bytes a microsecond: five packets in two milliseconds. A slow path has none.
        assert_eq!(burst(idle, 20_000, 10 * ms), 15);
        assert_eq!(burst(idle, 20_000, 600 * ms), 10);
        assert_eq!(burst(idle, 200_000, 10 * ms), 60);
        assert_eq!(burst(idle, 20_000_000, 10 * ms), LARGEST);
    }

    #[test]
    fn what_a_late_timer_held_up_leaves_at_once_and_idle_time_earns_nothing() {
        let leave = |held_up| {
            let mut pacer = Pacer::new(1000);
            let (start, rtt) = (Instant::from_nanos(0), Duration::from_millis(10));
            while pacer.ready(start, None, 20_000, rtt) == start {
                pacer.on_sent(1000);
            }
            let due = pacer.ready(start, None, 20_000, rtt);
            let late = due.after(Duration::from_millis(10));
            let mut due = Some(due).filter(|_| held_up);
            let mut count = 0;
            while pacer.ready(late, due.take(), 20_000, rtt) == late {
                pacer.on_sent(1000);
                count += 1;
            }
            count
        };
        // 2.5 bytes a microsecond, and the one that was due; ten and those due in two milliseconds.
        assert_eq!((leave(true), leave(false)), (25, 15));
    }
}
