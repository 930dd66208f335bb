//! The round-trip time, and the retransmission timeout (RFC 6298, as in Linux).

use std::time::Duration;

use trimaran_net::Instant;

/// Linux's `TCP_RTO_MIN`. It bounds the variance rather than the sum: the timeout is the round trip and at
/// least this.
pub(super) const RTO_MIN: Duration = Duration::from_millis(200);
/// Linux's `TCP_RTO_MAX`.
pub(super) const RTO_MAX: Duration = Duration::from_secs(120);
/// Before anything is measured (RFC 6298, section 2.1).
const RTO_INITIAL: Duration = Duration::from_secs(1);

/// How long a smallest round trip is remembered: Linux's `tcp_min_rtt_wlen`.
const MIN_WINDOW: Duration = Duration::from_secs(300);

#[derive(Debug, Default)]
pub(super) struct Rtt {
    smoothed: Option<Duration>,
    /// Four times the mean deviation, its largest value of this round trip, and the timeout's value.
    deviation: Duration,
    largest: Duration,
    variance: Duration,
    /// A round trip is over when this is acknowledged.
    round_end: u64,
    min: Option<(Duration, Instant)>,
    backoff: u32,
}

impl Rtt {
    /// A round trip was measured. `acknowledged` ends the peer's data, `next` is the next byte to send.
    pub(super) fn measure(&mut self, now: Instant, sample: Duration, acknowledged: u64, next: u64) {
        match self.min {
            Some((min, since)) if sample > min && now.since(since) < MIN_WINDOW => {}
            _ => self.min = Some((sample, now)),
        }
        let Some(smoothed) = self.smoothed else {
            self.smoothed = Some(sample);
            self.deviation = 2 * sample;
            self.variance = self.deviation.max(RTO_MIN);
            self.largest = self.variance;
            self.round_end = next;
            return;
        };
        self.smoothed = Some((smoothed * 7 + sample) / 8);
        let error = sample.abs_diff(smoothed);
        let quarter = self.deviation / 4;
        if error < quarter {
            self.deviation -= quarter - error;
        } else if sample < smoothed {
            // A shorter round trip is no reason to wait longer, so it counts only an eighth.
            self.deviation += (error - quarter) / 8;
        } else {
            self.deviation += error - quarter;
        }
        self.largest = self.largest.max(self.deviation);
        self.variance = self.variance.max(self.largest);
        if acknowledged > self.round_end {
            self.variance -= (self.variance - self.largest) / 4;
            self.round_end = next;
            self.largest = RTO_MIN;
        }
    }

    pub(super) const fn smoothed(&self) -> Option<Duration> {
        self.smoothed
    }

    /// The smallest recent round trip.
    pub(super) fn min(&self) -> Option<Duration> {
        self.min.map(|(min, _)| min)
    }

    /// The retransmission timeout.
    pub(super) fn timeout(&self) -> Duration {
        let base = self.smoothed.map_or(RTO_INITIAL, |smoothed| smoothed + self.variance);
        base.saturating_mul(1 << self.backoff.min(16)).min(RTO_MAX)
    }

    pub(super) const fn back_off(&mut self) {
        self.backoff += 1;
    }

    pub(super) const fn forgive(&mut self) {
        self.backoff = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    /// Measures these round trips, each in a round of its own.
    fn after(samples: impl IntoIterator<Item = u64>) -> Rtt {
        let mut rtt = Rtt::default();
        for (round, sample) in (0..).zip(samples) {
            rtt.measure(Instant::from_nanos(round), ms(sample), round + 1, round + 1);
        }
        rtt
    }

    #[test]
    fn the_timeout_is_the_round_trip_and_at_least_200_ms() {
        assert_eq!(Rtt::default().timeout(), ms(1000));
        assert_eq!(after([10]).timeout(), ms(210));
        assert_eq!(after([300]).timeout(), ms(900), "three times the first");
        assert_eq!(after([20; 50]).timeout(), ms(220));
        let mut rtt = after([20; 50]);
        rtt.back_off();
        rtt.back_off();
        assert_eq!(rtt.timeout(), ms(880));
        rtt.forgive();
        assert_eq!(rtt.timeout(), ms(220));
    }

    #[test]
    fn a_wild_way_has_a_longer_one_and_calms_down_slowly() {
        let wild = after((0..40).map(|round| if round % 2 == 0 { 100 } else { 500 }));
        assert!(wild.timeout() > ms(900), "{:?}", wild.timeout());
        let calm = after((0..40).map(|round| if round % 2 == 0 { 100 } else { 500 }).chain([100; 60]));
        assert_eq!(calm.timeout().as_millis(), 300);
        assert_eq!((wild.min(), calm.min()), (Some(ms(100)), Some(ms(100))));
    }
}
