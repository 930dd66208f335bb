//! The round-trip time of a path (RFC 9002, section 5).

use std::time::Duration;

/// The granularity of timers (RFC 9002, section 6.1.2).
pub(crate) const GRANULARITY: Duration = Duration::from_millis(1);

/// The assumed round trip before it is measured: local networks are faster, and RFC 9002's 333 ms would make
/// a lost first packet cost a second.
const INITIAL: Duration = Duration::from_millis(100);

/// The longest guess, which is the initial round trip of RFC 9002 (section 6.2.2): a first packet may have
/// been lost.
const LONGEST_GUESS: Duration = Duration::from_millis(333);

/// A smoothed round-trip time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rtt {
    /// Used until something is measured.
    guess: Duration,
    measured: Option<Measured>,
}

#[derive(Debug, Clone, Copy)]
struct Measured {
    latest: Duration,
    smoothed: Duration,
    variation: Duration,
    minimum: Duration,
}

impl Default for Rtt {
    fn default() -> Self {
        Self { guess: INITIAL, measured: None }
    }
}

impl Rtt {
    /// The handshake took a round trip, and at most this long.
    pub(crate) fn guess(&mut self, most: Duration) {
        self.guess = most.clamp(GRANULARITY, LONGEST_GUESS);
    }

    /// Takes a sample; the peer delayed the acknowledgement by `delay`.
    pub(crate) fn sample(&mut self, latest: Duration, delay: Duration) {
        let Some(rtt) = &mut self.measured else {
            self.measured =
                Some(Measured { latest, smoothed: latest, variation: latest / 2, minimum: latest });
            return;
        };
        rtt.latest = latest;
        rtt.minimum = rtt.minimum.min(latest);
        // A delay that would push the sample below the minimum is ignored.
        let sample = if latest >= rtt.minimum + delay { latest - delay } else { latest };
        rtt.variation = (rtt.variation * 3 + rtt.smoothed.abs_diff(sample)) / 4;
        rtt.smoothed = (rtt.smoothed * 7 + sample) / 8;
    }

    /// After persistent congestion the path may be another one (RFC 9002, section 5.2).
    pub(crate) fn forget_minimum(&mut self) {
        if let Some(rtt) = &mut self.measured {
            rtt.minimum = rtt.latest;
        }
    }

    pub(crate) fn smoothed(&self) -> Duration {
        self.measured.map_or(self.guess, |rtt| rtt.smoothed)
    }

    /// The approximate one-way delay; zero if it was not measured.
    pub(crate) fn one_way(&self) -> Duration {
        self.measured.map_or(Duration::ZERO, |rtt| rtt.smoothed / 2)
    }

    /// The least one-way delay, once it was measured.
    pub(crate) fn least_one_way(&self) -> Option<Duration> {
        self.measured.map(|rtt| rtt.minimum / 2)
    }

    /// The last measured round trip, and the shortest one, once there is any.
    pub(crate) fn latest_and_least(&self) -> Option<(Duration, Duration)> {
        self.measured.map(|rtt| (rtt.latest, rtt.minimum))
    }

    /// How long after a later packet's acknowledgement an earlier one counts as lost.
    pub(crate) fn loss_delay(&self) -> Duration {
        let longest = self.measured.map_or(self.guess, |rtt| rtt.latest.max(rtt.smoothed));
        (longest * 9 / 8).max(GRANULARITY)
    }

    /// How long to wait for an acknowledgement before probing, without backoff.
    pub(crate) fn probe_timeout(&self, max_ack_delay: Duration) -> Duration {
        let variation = self.measured.map_or(self.guess / 2, |rtt| rtt.variation);
        self.smoothed() + (variation * 4).max(GRANULARITY) + max_ack_delay
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn samples_are_smoothed_as_the_rfc_says() {
        let mut rtt = Rtt::default();
        rtt.sample(10 * MS, Duration::ZERO);
        assert_eq!((rtt.smoothed(), rtt.probe_timeout(MS)), (10 * MS, 31 * MS));
        rtt.sample(20 * MS, 2 * MS);
        // 10 * 7/8 + 18 / 8, and 5 * 3/4 + 8 / 4.
        assert_eq!(rtt.smoothed(), Duration::from_micros(11_000));
        assert_eq!(rtt.probe_timeout(Duration::ZERO), Duration::from_micros(11_000 + 4 * 5_750));
        assert_eq!(rtt.loss_delay(), 20 * MS * 9 / 8);
    }

    #[test]
    fn after_persistent_congestion_the_last_round_trip_is_the_shortest() {
        let mut rtt = Rtt::default();
        rtt.forget_minimum();
        assert_eq!(rtt.latest_and_least(), None);
        rtt.sample(10 * MS, Duration::ZERO);
        rtt.sample(20 * MS, Duration::ZERO);
        assert_eq!(rtt.latest_and_least(), Some((20 * MS, 10 * MS)));
        rtt.forget_minimum();
        assert_eq!(rtt.latest_and_least(), Some((20 * MS, 20 * MS)));
    }

    #[test]
    fn a_guess_holds_until_something_is_measured() {
        let mut rtt = Rtt::default();
        rtt.guess(20 * MS);
        assert_eq!((rtt.smoothed(), rtt.probe_timeout(MS)), (20 * MS, 61 * MS));
        rtt.guess(Duration::from_secs(9));
        assert_eq!((rtt.smoothed(), rtt.one_way()), (333 * MS, Duration::ZERO), "something was lost");
        rtt.sample(10 * MS, Duration::ZERO);
        rtt.guess(20 * MS);
        assert_eq!(rtt.smoothed(), 10 * MS);
    }

    #[test]
    fn a_delay_that_cannot_be_is_not_believed() {
        let mut rtt = Rtt::default();
        rtt.sample(10 * MS, Duration::ZERO);
        rtt.sample(10 * MS, 9 * MS);
        assert_eq!(rtt.smoothed(), 10 * MS);
    }
}
