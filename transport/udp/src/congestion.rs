//! The congestion window: CUBIC (RFC 9438), with the validation of RFC 7661. It cannot be turned off.

use std::time::Duration;

use trimaran_net::Instant;

/// The window's factor after a loss (RFC 9438, section 4.6).
const BETA: f64 = 0.7;
/// The growth of the window, in segments per second cubed (RFC 9438, section 5).
const C: f64 = 0.4;
/// The smallest window, in segments (RFC 9002, section 7.2).
const MINIMUM: f64 = 2.0;
/// The most bytes that a segment counts for in the initial window (the same section: ten have 14,720), unless
/// two segments are more.
const LARGEST_INITIAL: f64 = 1_472.0;

/// The congestion window. All sizes are in segments of the path inside, in bytes outside.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    segment: f64,
    window: f64,
    /// The initial window.
    initial: f64,
    /// Nothing is known of the path yet.
    is_initial: bool,
    threshold: f64,
    /// The window before the last reduction.
    peak: f64,
    /// The window of Reno.
    reno: f64,
    /// The start of congestion avoidance since the last reduction.
    epoch: Option<Instant>,
    /// Packets sent before this do not reduce the window again.
    recovery: Option<Instant>,
}

impl Window {
    /// A window of `initial` segments.
    pub(crate) fn new(segment: usize, initial: u16) -> Self {
        let initial = f64::from(initial).max(MINIMUM);
        Self {
            segment: segment as f64,
            window: initial,
            initial,
            is_initial: true,
            threshold: f64::INFINITY,
            peak: 0.0,
            reno: 0.0,
            epoch: None,
            recovery: None,
        }
    }

    /// Packets have another size from now on. The window keeps its bytes. An initial window that nothing has
    /// changed keeps its number of packets, but not more bytes than [`LARGEST_INITIAL`] allows.
    pub(crate) fn set_segment(&mut self, segment: usize) {
        if self.is_initial {
            self.segment = segment as f64;
            self.window = self.initial.min(self.initial * LARGEST_INITIAL / self.segment).max(MINIMUM);
            return;
        }
        let ratio = self.segment / segment as f64;
        for size in [&mut self.window, &mut self.threshold, &mut self.peak, &mut self.reno] {
            *size *= ratio;
        }
        self.segment = segment as f64;
    }

    /// Bytes that may be in flight.
    pub(crate) fn window(&self) -> usize {
        (self.window * self.segment) as usize
    }

    /// `bytes` sent at `sent` were acknowledged; `in_flight` bytes were in flight before.
    pub(crate) fn on_ack(
        &mut self,
        now: Instant,
        sent: Instant,
        bytes: usize,
        in_flight: usize,
        rtt: Duration,
    ) {
        let recovering = self.recovery.is_some_and(|start| sent <= start);
        // A window used by less than half says nothing about the path, and must not grow (RFC 7661, section
        // 4.3).
        if recovering || in_flight * 2 < self.window() {
            return;
        }
        self.is_initial = false;
        let acked = bytes as f64 / self.segment;
        if self.window < self.threshold {
            self.window += acked;
            return;
        }
        let epoch = *self.epoch.get_or_insert_with(|| {
            self.reno = self.window;
            self.peak = self.peak.max(self.window);
            now
        });
        self.reno += 3.0 * (1.0 - BETA) / (1.0 + BETA) * acked / self.window;
        let k = ((self.peak - self.peak.min(self.threshold)) / C).cbrt();
        let at = (now.since(epoch) + rtt).as_secs_f64() - k;
        let target = (C * at * at * at + self.peak).clamp(self.window, 1.5 * self.window);
        let step = (target - self.window) / self.window * acked;
        self.window = (self.window + step).max(self.reno);
    }

    /// A packet sent at `sent` was lost. The losses of one round trip count once.
    pub(crate) fn on_loss(&mut self, now: Instant, sent: Instant) {
        if self.recovery.is_some_and(|start| sent <= start) {
            return;
        }
        self.recovery = Some(now);
        self.is_initial = false;
        self.epoch = None;
        // Fast convergence: a loss below the last peak leaves room to others (RFC 9438, section 4.7).
        self.peak = if self.window < self.peak { self.window * (1.0 + BETA) / 2.0 } else { self.window };
        self.window = (self.window * BETA).max(MINIMUM);
        self.threshold = self.window;
    }

    /// All packets over a long time were lost (RFC 9002, section 7.6).
    pub(crate) fn on_persistent_congestion(&mut self) {
        self.threshold = (self.window * BETA).max(MINIMUM);
        self.is_initial = false;
        self.window = MINIMUM;
        self.epoch = None;
        self.recovery = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cubic(segment: usize) -> Window {
        Window::new(segment, 10)
    }

    const RTT: Duration = Duration::from_millis(10);

    fn at(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn the_window_doubles_each_round_trip_until_a_loss() {
        let mut cubic = cubic(1000);
        assert_eq!(cubic.window(), 10_000);
        cubic.on_ack(at(10), at(0), 10_000, 10_000, RTT);
        assert_eq!(cubic.window(), 20_000);
        cubic.on_loss(at(20), at(11));
        assert_eq!(cubic.window(), 14_000);
        cubic.on_loss(at(21), at(12));
        assert_eq!(cubic.window(), 14_000, "the same round trip");
        cubic.on_loss(at(40), at(30));
        assert_eq!(cubic.window() / 10, 979, "two reductions, rounded down");
    }

    #[test]
    fn larger_packets_are_fewer() {
        let mut cubic = cubic(1200);
        cubic.on_ack(at(10), at(0), 12_000, 12_000, RTT);
        cubic.set_segment(1500);
        assert_eq!(cubic.window(), 24_000);
        (0..20).for_each(|round| cubic.on_loss(at(2 * round + 1), at(2 * round + 1)));
        assert_eq!(cubic.window(), 3_000, "two of the new ones");
    }

    #[test]
    fn the_initial_window_is_ten_packets_of_the_size_that_is_known() {
        let mut cubic = cubic(1200);
        for (segment, window) in [(1452, 14_520), (1840, 14_720), (9000, 18_000), (1200, 12_000)] {
            cubic.set_segment(segment);
            assert_eq!(cubic.window(), window);
        }
        cubic.on_loss(at(1), at(0));
        cubic.set_segment(1452);
        assert_eq!(cubic.window(), 8_400, "it keeps its bytes");
    }

    #[test]
    fn an_unused_window_does_not_grow() {
        let mut cubic = cubic(1000);
        cubic.on_ack(at(10), at(0), 4_000, 4_000, RTT);
        assert_eq!(cubic.window(), 10_000);
        cubic.on_ack(at(10), at(0), 5_000, 5_000, RTT);
        assert_eq!(cubic.window(), 15_000);
    }

    #[test]
    fn after_a_loss_the_window_comes_back_to_its_peak() {
        let mut cubic = cubic(1000);
        cubic.on_ack(at(10), at(0), 90_000, 90_000, RTT);
        cubic.on_loss(at(20), at(15));
        assert_eq!(cubic.window(), 70_000);
        // The peak is due after cbrt(30 / 0.4) = 4.2 s; at this round trip Reno would be at 81 by then.
        let rtt = Duration::from_millis(200);
        let mut before = cubic.window();
        for round in 1..22 {
            let window = cubic.window();
            cubic.on_ack(at(round * 200), at(round * 200 - 150), window, window, rtt);
            assert!(cubic.window() >= before);
            before = cubic.window();
        }
        assert!((98_000..=101_000).contains(&before), "{before}");
    }

    /// These windows are three seconds below the middle of their cube: cbrt(10.8 / 0.4). It is the window
    /// before the loss, and 0.85 of that if the loss came below the last peak.
    #[test]
    fn a_window_follows_the_cube_around_its_peak() {
        for (before, lost_at, peak) in [(10, 36, 36_000), (36, 36, 36_000), (100, 72, 61_200)] {
            for (seconds, above) in [(1, -3_200), (2, -400), (3, 0), (4, 400)] {
                let mut cubic = Window::new(1000, before);
                cubic.on_loss(at(10), at(0));
                cubic.on_persistent_congestion();
                cubic.on_ack(at(30), at(20), (lost_at - 2) * 1000, 2_000, RTT);
                assert_eq!(cubic.window(), lost_at * 1000);
                cubic.on_loss(at(40), at(30));
                // The first acknowledgement starts the cube.
                let window = cubic.window();
                cubic.on_ack(at(60), at(50), 0, window, RTT);
                let half = 500;
                let (now, rtt) = (at(60 + 1000 * seconds - half), Duration::from_millis(half));
                cubic.on_ack(now, at(61), window, window, rtt);
                let off = cubic.window() as i64 - (peak + above);
                assert!(off.abs() <= 2, "{before}, {lost_at}, {seconds} s: {off} bytes off");
            }
        }
    }

    #[test]
    fn a_window_grows_by_no_more_than_half_at_once() {
        let mut cubic = Window::new(1000, 36);
        cubic.on_loss(at(10), at(0));
        let window = cubic.window();
        cubic.on_ack(at(20), at(11), window, window, Duration::from_secs(10));
        assert_eq!(cubic.window() / 10, 3_780, "37.8 segments after 25.2");
    }

    #[test]
    fn persistent_congestion_leaves_two_segments() {
        let mut cubic = cubic(1000);
        cubic.on_persistent_congestion();
        assert_eq!(cubic.window(), 2_000);
        // They double again up to 0.7 of the window before. Then Reno adds 9/17 of a segment a round trip.
        for (bytes, window) in [(5_000, 7_000), (7_000, 7_529)] {
            cubic.on_ack(at(10), at(0), bytes, bytes, RTT);
            assert_eq!(cubic.window(), window);
        }
        for _ in 0..20 {
            cubic.on_loss(at(1), at(2));
        }
        assert_eq!(cubic.window(), 2_000);
    }
}
