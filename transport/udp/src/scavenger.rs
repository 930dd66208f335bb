//! How much may be under way for the bulk lane to add to it: less than would queue on the path, so that what
//! other lanes say later finds no queue (a scavenger, as LEDBAT is one: RFC 6817).

use std::time::Duration;

use trimaran_net::Instant;

/// So many packets may always be under way: one that travels, and one whose acknowledgement does.
const LEAST: usize = 2;
/// So many packets may be at first: on 10 Mbit/s a frame waits 4 ms behind them, once.
const FIRST: usize = 4;
/// What timers and late acknowledgements add to a round trip without any queue.
const SLACK: Duration = Duration::from_millis(2);
/// While the window doubles it can leap far beyond the path: a sign of a queue is enough, so much smaller.
const CAUTION: u32 = 4;

/// A window that gives way to a queue. It doubles behind each round trip that saw none and used it up, until
/// one saw one; from then on it grows by a packet. A round trip that saw a queue halves it. Between two that
/// are looked at passes another one, in which what was changed shows.
#[derive(Debug)]
pub(crate) struct Scavenger {
    segment: usize,
    window: usize,
    doubles: bool,
    /// From when on the round trips are those of this window.
    settled: Option<Instant>,
    round: Option<Round>,
}

/// A round trip, from an acknowledgement on.
#[derive(Debug)]
struct Round {
    ends: Instant,
    /// The shortest round trip that was measured in it: a queue makes all of them longer.
    shortest: Duration,
    /// All that may be under way was.
    used_up: bool,
}

impl Scavenger {
    pub(crate) const fn new(segment: usize) -> Self {
        Self { segment, window: FIRST * segment, doubles: true, settled: None, round: None }
    }

    /// The size of packets has changed.
    pub(crate) fn set_segment(&mut self, segment: usize) {
        self.segment = segment;
        self.window = self.window.max(LEAST * segment);
    }

    /// Whether the bulk lane may add a packet to what is under way.
    pub(crate) const fn allows(&self, in_flight: usize) -> bool {
        in_flight + self.segment <= self.window
    }

    /// Something was acknowledged that had been under way with `in_flight` bytes in all. It took `latest`,
    /// and the `least` that was ever measured on this path.
    pub(crate) fn on_ack(&mut self, now: Instant, in_flight: usize, latest: Duration, least: Duration) {
        if self.settled.is_some_and(|settled| now < settled) {
            return;
        }
        let used_up = !self.allows(in_flight);
        let round =
            self.round.get_or_insert(Round { ends: now.after(latest), shortest: latest, used_up: false });
        round.shortest = round.shortest.min(latest);
        round.used_up |= used_up;
        if now < round.ends {
            return;
        }
        let caution = if self.doubles { CAUTION } else { 1 };
        let queues = round.shortest > least + (least / 4).max(SLACK) / caution;
        if queues {
            self.doubles = false;
            self.window = (self.window / 2).max(LEAST * self.segment);
        } else if round.used_up {
            self.window += if self.doubles { self.window } else { self.segment };
        }
        (self.round, self.settled) = (None, Some(now.after(latest)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEGMENT: usize = 1000;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// The window after round trips of so many milliseconds each, over a path of ten; all used up, or none.
    fn after(rounds: &[u64], used_up: bool) -> usize {
        let (mut scavenger, mut now) = (Scavenger::new(SEGMENT), Instant::from_nanos(0));
        for round in rounds {
            for _ in 0..2 {
                let in_flight = if used_up { scavenger.window } else { 0 };
                scavenger.on_ack(now, in_flight, ms(*round), ms(10));
                now = now.after(ms(*round));
            }
        }
        scavenger.window / SEGMENT
    }

    #[test]
    fn the_window_doubles_until_something_queues_and_grows_by_a_packet_then() {
        assert_eq!(after(&[10; 3], true), 32);
        assert_eq!(after(&[10, 10, 10, 11], true), 16);
        assert_eq!(after(&[10, 10, 10, 11, 12, 12], true), 18);
    }

    #[test]
    fn a_window_that_is_not_used_up_does_not_grow_and_two_packets_are_always_allowed() {
        assert_eq!(after(&[10; 9], false), FIRST);
        assert_eq!(after(&[10, 50, 50, 50, 50], true), LEAST);
        let at_first = Scavenger::new(SEGMENT);
        assert!(at_first.allows(3 * SEGMENT) && !at_first.allows(3 * SEGMENT + 1));
    }

    #[test]
    fn one_short_round_trip_shows_that_the_others_found_a_busy_machine() {
        let mut scavenger = Scavenger::new(SEGMENT);
        for (at, latest) in [(0, 30), (20, 10), (40, 30)] {
            scavenger.on_ack(Instant::from_nanos(at * 1_000_000), FIRST * SEGMENT, ms(latest), ms(10));
        }
        assert_eq!(scavenger.window, 2 * FIRST * SEGMENT);
        // What was sent before the window grew shows nothing of it.
        scavenger.on_ack(Instant::from_nanos(41_000_000), 2 * FIRST * SEGMENT, ms(10), ms(10));
        scavenger.on_ack(Instant::from_nanos(60_000_000), 2 * FIRST * SEGMENT, ms(10), ms(10));
        assert_eq!(scavenger.window, 2 * FIRST * SEGMENT);
    }
}
