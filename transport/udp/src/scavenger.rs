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
/// Fewer acknowledgements do not tell a queue from a delay that varies. So many of a window that doubles
/// tell it before their round trip is over (as in HyStart++, RFC 9406, section 4.2).
const FEW: u32 = 2;
/// What the window grows by in a round trip, once it does not double any more: a share of it that queues for
/// less than what is taken for a queue.
const GROWTH: usize = 8;
/// What a queue takes of a window that does not double any more, a share of it. A delay that varies looks
/// like a queue now and then: half of it would keep the window small on a wireless network.
const SHRINK: usize = 4;

/// A window that gives way to a queue.
#[derive(Debug)]
pub(crate) struct Scavenger {
    segment: usize,
    window: usize,
    /// It grows by what is acknowledged, and so doubles behind each round trip, until all of one saw a queue.
    /// From then on it grows by little, and a queue shrinks it.
    doubles: bool,
    /// From when on the round trips are those of this window.
    settled: Option<Instant>,
    round: Option<Round>,
}

/// A round trip, from an acknowledgement on.
#[derive(Debug)]
struct Round {
    ends: Instant,
    acknowledgements: u32,
    /// The shortest round trip that was measured in it: a queue makes all of them longer.
    shortest: Duration,
    /// Half of what may be under way was.
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

    /// So many bytes were acknowledged that had been under way with others, `in_flight` in all. It took
    /// `latest`, and the `least` that was ever measured on this path.
    pub(crate) fn on_ack(
        &mut self,
        now: Instant,
        acknowledged: usize,
        in_flight: usize,
        latest: Duration,
        least: Duration,
    ) {
        // What is paced is never under way as a whole (RFC 7661, section 4.3).
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

    /// A line of so many packets a millisecond, with a round trip of so many milliseconds and up to
    /// `varies` more.
    struct Line {
        packets: f64,
        trip: f64,
        varies: f64,
    }

    /// Sends packets of blocks for a time, as many as may be. Gives the share of the line that they had, and
    /// how long the last ones waited in the queue, milliseconds.
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
            // What is taken for a queue, and what is added before it is seen.
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
        // 4 packets, 8, 16, .. 128 are 252 in six round trips; each takes 40 ms and what it sends takes.
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
    }
}
