//! The limit of data in flight up to which the bulk lane may send: less than would queue on the path, so that
//! later data of other lanes finds no queue (a scavenger, like LEDBAT: RFC 6817).

use std::time::Duration;

use trimaran_net::Instant;

/// So many packets may always be in flight: one travels, and one is being acknowledged.
const LEAST: usize = 2;
/// The initial window in packets: on 10 Mbit/s a frame waits 4 ms behind them, once.
const FIRST: usize = 4;
/// The time that timers and late acknowledgements add to a round trip without any queue.
const SLACK: Duration = Duration::from_millis(2);
/// Divides the threshold of a queue while the window doubles, as it can then leap far beyond the path.
const CAUTION: u32 = 4;
/// Fewer acknowledgements do not distinguish a queue from a varying delay. For a doubling window so many show
/// it before their round trip ends (as in HyStart++, RFC 9406, section 4.2).
const FEW: u32 = 2;
/// The share by which the window grows in a round trip after doubling: it queues for less than the threshold
/// of a queue.
const GROWTH: usize = 8;
/// The share by which a queue shrinks the window after doubling. A varying delay looks like a queue now and
/// then: half would keep the window small on a wireless network.
const SHRINK: usize = 4;

/// A window that yields to a queue.
#[derive(Debug)]
pub(crate) struct Scavenger {
    segment: usize,
    window: usize,
    /// It grows by acknowledged bytes, and so doubles in each round trip, until all of one saw a queue. From
    /// then on it grows by little, and a queue shrinks it.
    doubles: bool,
    /// The time from which round trips belong to this window.
    settled: Option<Instant>,
    round: Option<Round>,
}

/// A round trip, from an acknowledgement on.
#[derive(Debug)]
struct Round {
    ends: Instant,
    acknowledgements: u32,
    /// The shortest round trip measured in it: a queue makes all of them longer.
    shortest: Duration,
    /// Half of the window was used.
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

    /// Whether the bulk lane may add a packet to those in flight.
    pub(crate) const fn allows(&self, in_flight: usize) -> bool {
        in_flight + self.segment <= self.window
    }

    /// So many bytes were acknowledged that had been in flight with others, `in_flight` in all. The round
    /// trip took `latest`, and the `least` ever measured on this path.
    pub(crate) fn on_ack(
        &mut self,
        now: Instant,
        acknowledged: usize,
        in_flight: usize,
        latest: Duration,
        least: Duration,
    ) {
        // Paced data is never in flight as a whole (RFC 7661, section 4.3).
        let used_up = 2 * in_flight >= self.window;
        let caution = if self.doubles { CAUTION } else { 1 };
        let most = least + (least / 4).max(SLACK) / caution;
        if self.doubles && used_up && latest <= most {
            self.window += acknowledged;
        }
        if self.settled.is_some_and(|settled| now < settled) {
            return;
        }
        let round = self.round.get_or_insert(Round {
            ends: now.after(latest),
            acknowledgements: 0,
            shortest: latest,
            used_up: false,
        });
        round.acknowledgements += 1;
        round.shortest = round.shortest.min(latest);
        round.used_up |= used_up;
        let queues = round.shortest > most;
        if round.acknowledgements < FEW {
            return;
        }
        let is_over = now >= round.ends;
        if queues && (is_over || self.doubles) {
            let gives_up = self.window / if self.doubles { 2 } else { SHRINK };
            self.window = (self.window - gives_up).max(LEAST * self.segment);
            self.doubles = false;
        } else if is_over && !self.doubles && round.used_up {
            self.window += (self.window / GROWTH).max(self.segment);
        } else {
            if is_over {
                self.round = None;
            }
            return;
        }
        (self.round, self.settled) = (None, Some(now.after(latest)));
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;

    const SEGMENT: usize = 1000;

    fn ms(ms: f64) -> Duration {
        Duration::from_secs_f64(ms / 1e3)
    }

    /// A line of so many packets a millisecond, with a round trip of so many milliseconds and up to `varies`
    /// more.
    struct Line {
        packets: f64,
        trip: f64,
        varies: f64,
    }

    /// Sends packets of blocks for a time, as many as allowed. Returns their share of the line, and the time
    /// the last ones waited in the queue, milliseconds.
    fn over(line: &Line, lasts: f64) -> (f64, f64) {
        let (mut scavenger, mut now, mut free, mut taken) = (Scavenger::new(SEGMENT), 0.0_f64, 0.0_f64, 0);
        let (mut under_way, mut least, mut dice, mut waited) = (VecDeque::new(), f64::INFINITY, 1_u32, 0.0);
        let mut last_ack = 0.0_f64;
        while now < lasts {
            while scavenger.allows(under_way.len() * SEGMENT) {
                waited = (free - now).max(0.0);
                free = free.max(now) + 1.0 / line.packets;
                dice = dice.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                // Packets stay in order.
                last_ack = last_ack.max(free + line.trip + line.varies * f64::from(dice >> 8) / 16_777_216.0);
                under_way.push_back((now, last_ack));
            }
            let in_flight = under_way.len() * SEGMENT;
            let (sent, back) = under_way.pop_front().unwrap();
            (now, taken) = (back, taken + 1);
            least = least.min(back - sent);
            let at = Instant::from_nanos((now * 1e6) as u64);
            scavenger.on_ack(at, SEGMENT, in_flight, ms(back - sent), ms(least));
        }
        (f64::from(taken) / line.packets / lasts, waited)
    }

    #[test]
    fn a_line_is_filled_and_its_queue_stays_short() {
        for (packets, trip) in [(1.0, 4.0), (1.0, 40.0), (10.0, 4.0), (10.0, 40.0), (100.0, 40.0)] {
            let (share, waited) = over(&Line { packets, trip, varies: 0.0 }, 5000.0);
            assert!(share > 0.8, "{packets} packets/ms, {trip} ms: {share} of the line");
            // The threshold of a queue, and the data added before it is seen.
            let most = 2.5 * (trip / 4.0).max(2.0) + 2.0 / packets;
            assert!(waited < most, "{packets} packets/ms, {trip} ms: {waited} ms in the queue");
        }
    }

    #[test]
    fn a_delay_that_varies_is_not_taken_for_a_queue() {
        let (share, _) = over(&Line { packets: 10.0, trip: 4.0, varies: 3.0 }, 5000.0);
        assert!(share > 0.75, "{share} of the line");
    }

    #[test]
    fn a_wide_line_is_reached_within_a_few_round_trips() {
        // 4 packets, 8, 16, .. 128 are 252 in six round trips; each takes 40 ms and the time of its packets.
        let (share, _) = over(&Line { packets: 10.0, trip: 40.0, varies: 0.0 }, 6.0 * 45.0);
        let packets = share * 10.0 * 6.0 * 45.0;
        assert!(packets > 220.0, "{packets} packets");
    }

    #[test]
    fn a_window_that_is_not_used_does_not_grow_and_two_packets_are_always_allowed() {
        let mut scavenger = Scavenger::new(SEGMENT);
        assert!(scavenger.allows(3 * SEGMENT) && !scavenger.allows(3 * SEGMENT + 1));
        for round in 0..20 {
            scavenger.on_ack(Instant::from_nanos(10_000_000 * round), SEGMENT, SEGMENT, ms(10.0), ms(10.0));
        }
        assert_eq!(scavenger.window, FIRST * SEGMENT);
        for round in 20..99 {
            scavenger.on_ack(Instant::from_nanos(10_000_000 * round), SEGMENT, SEGMENT, ms(50.0), ms(10.0));
        }
        assert_eq!(scavenger.window, LEAST * SEGMENT);
        scavenger.set_segment(1500);
        assert!(scavenger.allows(1500) && !scavenger.allows(1501), "two of the new size");
    }

    #[test]
    fn one_long_round_trip_is_no_queue_and_two_are() {
        let mut scavenger = Scavenger::new(SEGMENT);
        // The threshold of a queue is 50 ms here, and 42.5 ms while the window doubles.
        for (now, latest, window, why) in [
            (0, 42.5, 5_000, "no queue"),
            (1, 42.5, 6_000, "no queue"),
            (50, 50.0, 6_000, "a queue, but not in all of a round trip"),
            (51, 50.0, 6_000, "one may be by chance"),
            (52, 50.0, 3_000, "two are a queue"),
            (101, 45.0, 3_000, "sent before the window shrank"),
            (102, 60.0, 3_000, "the first since"),
            (162, 60.0, 2_250, "another queue"),
        ] {
            let at = Instant::from_nanos(now * 1_000_000);
            scavenger.on_ack(at, SEGMENT, 9 * SEGMENT, ms(latest), ms(40.0));
            assert_eq!(scavenger.window, window, "{now} ms: {why}");
        }
    }
}
