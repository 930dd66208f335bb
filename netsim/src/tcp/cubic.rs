//! The congestion window: CUBIC (RFC 9438) with HyStart, in Linux's constants.

use std::time::Duration;

use trimaran_net::Instant;

/// The window's factor after a loss, and the steepness of the cubic, in packets and seconds.
const BETA: f64 = 717.0 / 1024.0;
const STEEPNESS: f64 = 410.0 / 1024.0;
/// HyStart: the smallest window in packets; the largest gap within a train of acknowledgements; the samples
/// for a round's delay.
const LOW_WINDOW: u32 = 16;
const TRAIN_GAP: Duration = Duration::from_millis(2);
const SAMPLES: u32 = 8;
/// Linux recomputes the growth of an unchanged window only after this time: a 32nd of a second.
const PACE_HOLDS: Duration = Duration::from_micros(31_250);

#[derive(Debug, Default)]
pub(super) struct Cubic {
    /// The window at the last loss.
    last_max: f64,
    /// When growth began after it, the window that it grows back to, and after how long.
    epoch: Option<Instant>,
    origin: f64,
    until_origin: f64,
    /// Reno's window by now, and packets acknowledged towards its next increase.
    reno: f64,
    acked: f64,
    /// Packets acknowledged towards our next increase.
    credit: f64,
    /// Acknowledgements per further packet as last computed, when, and for which window.
    each: f64,
    found: Option<(Instant, u32)>,
    round: Round,
}

/// One round trip as HyStart sees it.
#[derive(Debug, Default)]
struct Round {
    end: u64,
    start: Instant,
    last_ack: Instant,
    min: Option<Duration>,
    samples: u32,
}

impl Cubic {
    /// The slow start threshold after a loss at a window of `cwnd`.
    pub(super) fn after_loss(&mut self, cwnd: u32) -> u32 {
        let cwnd = f64::from(cwnd);
        self.epoch = None;
        // Leaves room to other connections: a maximum below the old one (fast convergence).
        self.last_max = if cwnd < self.last_max { cwnd * (1.0 + BETA) / 2.0 } else { cwnd };
        ((cwnd * BETA) as u32).max(2)
    }

    /// Forgets everything after a timeout.
    pub(super) const fn reset(&mut self) {
        self.last_max = 0.0;
        self.epoch = None;
        self.credit = 0.0;
    }

    /// Nothing was in flight for so long. That time does not count, so a pause does not enlarge the window.
    pub(super) fn skip(&mut self, idle: Duration) {
        self.epoch = self.epoch.map(|epoch| epoch.after(idle));
    }

    /// Whether slow start should end without a loss: the queue grows, or the path is full.
    pub(super) fn leaves_slow_start(&mut self, now: Instant, ack: Ack, cwnd: u32) -> bool {
        let round = &mut self.round;
        if ack.acknowledged > round.end {
            *round = Round { end: ack.next, start: now, last_ack: now, min: None, samples: 0 };
        }
        if cwnd < LOW_WINDOW {
            return false;
        }
        let mut leaves = false;
        if now.since(round.last_ack) <= TRAIN_GAP {
            round.last_ack = now;
            // Half the round trip, since Linux does not pace here: a train fills the path once and back.
            leaves |= now.since(round.start) > ack.min_rtt / 2;
        }
        if round.samples < SAMPLES {
            round.samples += 1;
            round.min = Some(round.min.map_or(ack.rtt, |min| min.min(ack.rtt)));
        } else if let Some(min) = round.min {
            let slack = (ack.min_rtt / 8).clamp(Duration::from_millis(4), Duration::from_millis(16));
            leaves |= min > ack.min_rtt + slack;
        }
        leaves
    }

    /// The window after `acked` more packets were acknowledged beyond slow start.
    pub(super) fn grow(&mut self, now: Instant, cwnd: u32, acked: u32, min_rtt: Duration) -> u32 {
        self.acked += f64::from(acked);
        let holds = |(at, window)| window == cwnd && now.since(at) <= PACE_HOLDS;
        if !self.found.is_some_and(holds) {
            self.found = Some((now, cwnd));
            self.each = self.pace(now, f64::from(cwnd), f64::from(acked), min_rtt);
        }
        let mut more = 0.0;
        // Credit gathered at a slower pace counts for one packet at most.
        if self.credit >= self.each {
            (more, self.credit) = (1.0, 0.0);
        }
        self.credit += f64::from(acked);
        let full = libm::floor(self.credit / self.each);
        self.credit -= full * self.each;
        cwnd.saturating_add((more + full) as u32)
    }

    /// The number of acknowledgements per further packet.
    fn pace(&mut self, now: Instant, window: f64, acked: f64, min_rtt: Duration) -> f64 {
        let epoch = *self.epoch.get_or_insert_with(|| {
            self.acked = acked;
            self.reno = window;
            self.credit = 0.0;
            if self.last_max <= window {
                (self.until_origin, self.origin) = (0.0, window);
            } else {
                self.until_origin = libm::cbrt((self.last_max - window) / STEEPNESS);
                self.origin = self.last_max;
            }
            now
        });
        let time = (now.since(epoch) + min_rtt).as_secs_f64() - self.until_origin;
        let target = self.origin + STEEPNESS * time * time * time;
        let mut each = if target > window { window / (target - window) } else { 100.0 * window };
        if self.last_max == 0.0 {
            each = each.min(20.0);
        }
        let reno_each = window * (1.0 + BETA) / (3.0 * (1.0 - BETA));
        while self.acked > reno_each {
            self.acked -= reno_each;
            self.reno += 1.0;
        }
        if self.reno > window {
            each = each.min(libm::floor(window / (self.reno - window)));
        }
        each.max(2.0)
    }
}

/// An acknowledgement as HyStart sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ack {
    pub(super) acknowledged: u64,
    pub(super) next: u64,
    pub(super) rtt: Duration,
    pub(super) min_rtt: Duration,
}

#[cfg(test)]
mod tests {
    use super::*;

    const RTT: Duration = Duration::from_millis(100);

    /// Grows a window for some round trips after a loss at `max`, and returns it after each.
    fn growth(max: u32, rounds: u64) -> Vec<u32> {
        let mut cubic = Cubic::default();
        let mut cwnd = cubic.after_loss(max);
        (0..rounds)
            .map(|round| {
                let packets = cwnd;
                for _ in 0..packets {
                    cwnd = cubic.grow(Instant::from_nanos(round * 100_000_000), cwnd, 1, RTT);
                }
                cwnd
            })
            .collect()
    }

    #[test]
    fn the_window_returns_to_its_maximum_after_the_cubes_time() {
        // RFC 9438: K = cbrt(W_max (1 - beta) / C), here 9 s at 1000 packets.
        let windows = growth(1000, 200);
        let reached = windows.iter().position(|w| *w >= 990).unwrap() as f64 / 10.0;
        let k = (1000.0 * (1.0 - BETA) / STEEPNESS).cbrt();
        assert!(reached < k && reached > k - 4.0, "{reached} {k}");
        let at = |seconds: f64| f64::from(windows[(seconds * 10.0) as usize]);
        assert!((at(k) - 1000.0).abs() < 12.0, "flat around the maximum: {}", at(k));
        assert!((at(k + 4.0) - (1000.0 + STEEPNESS * 64.0)).abs() < 25.0, "{}", at(k + 4.0));
    }

    #[test]
    fn small_windows_grow_as_renos_do() {
        // Additive increase of 3 (1 - beta) / (1 + beta) packets a round trip.
        let windows = growth(20, 30);
        let slope = 3.0 * (1.0 - BETA) / (1.0 + BETA);
        assert!((f64::from(windows[20]) - (14.0 + 21.0 * slope)).abs() < 2.5, "{windows:?}");
    }

    #[test]
    fn a_loss_takes_three_tenths_and_a_second_one_before_recovery_makes_room() {
        let mut cubic = Cubic::default();
        assert_eq!(cubic.after_loss(100), 70);
        assert_eq!(cubic.last_max, 100.0);
        assert_eq!(cubic.after_loss(80), 56);
        assert!(cubic.last_max < 70.0);
        assert_eq!(cubic.after_loss(1), 2);
    }

    #[test]
    fn slow_start_ends_when_the_delay_grows() {
        let mut cubic = Cubic::default();
        let ack = |rtt| Ack { acknowledged: 1, next: 1000, rtt, min_rtt: RTT };
        for n in 0..8 {
            let now = Instant::from_nanos(n * 3_000_000);
            assert!(!cubic.leaves_slow_start(now, ack(RTT + Duration::from_millis(20)), 40));
        }
        let now = Instant::from_nanos(24_000_000);
        assert!(!cubic.leaves_slow_start(now, ack(RTT), LOW_WINDOW - 1));
        assert!(cubic.leaves_slow_start(now, ack(RTT), 40));
    }

    #[test]
    fn the_same_window_grows_at_the_same_pace_for_a_32nd_of_a_second() {
        let ms = |millis: u64| Instant::from_nanos(millis * 1_000_000);
        let mut cubic = Cubic::default();
        let window = cubic.after_loss(20);
        assert_eq!(cubic.grow(ms(0), window, 1, Duration::ZERO), window);
        // Reno would have grown long ago, but growth is not recomputed yet.
        assert_eq!(cubic.grow(ms(20), window, 200, Duration::ZERO), window);
        assert_eq!(
            cubic.grow(ms(40), window, 1, Duration::ZERO),
            window + 1,
            "all of that is worth one packet"
        );
        assert_eq!(
            cubic.grow(ms(41), window + 1, 4, Duration::ZERO),
            window + 3,
            "another window: another look"
        );
    }

    #[test]
    fn time_in_which_nothing_is_sent_does_not_make_the_window_grow() {
        let at = |seconds: u64| Instant::from_nanos(seconds * 1_000_000_000);
        let after = |idle: u64| {
            let mut cubic = Cubic::default();
            let window = cubic.after_loss(100);
            assert_eq!(cubic.grow(at(0), window, 1, RTT), window);
            cubic.skip(Duration::from_secs(idle));
            cubic.grow(at(8), window, 20, RTT) - window
        };
        // The old window is reached after 4.2 s; from then on growth speeds up.
        assert_eq!((after(0), after(8)), (10, 0));
    }
}
