//! Signs of congestion, for connections with a congestion control of their own.

use std::time::Duration;

/// Up to this share, and while nothing queues, losses count as random loss on the path (as in BBR: section
/// 4.5.2 of draft-ietf-ccwg-bbr).
const RANDOM_LOSS: f64 = 0.02;
/// The same for a sender that runs out of data, as one of frames does between two of them. It does not fill
/// the path, and a smaller window would delay its frames rather than make it send less.
const RANDOM_LOSS_OF_BURSTS: f64 = 0.05;
/// A sender has run out of data if it did so within so many packets.
const BURST: u32 = 256;
/// It is counted over about this many packets: enough that bursts of losses, at one packet in a hundred,
/// hardly ever look like two.
const MEMORY: f64 = 4096.0;
/// Such a share of about so many packets is not random, even after few losses: the window has outgrown the
/// path.
const SUDDEN: f64 = 0.1;
const SUDDEN_MEMORY: f64 = 256.0;

/// The time that timers and late acknowledgements add to a round trip without any queue.
const SLACK: Duration = Duration::from_millis(3);
/// How many round trips distinguish a queue from a busy machine.
const FEW: u32 = 32;

/// Whether losses on a path are congestion or random: by the share of lost packets, and by the queue that
/// longer round trips show.
#[derive(Debug, Clone, Default)]
pub struct CongestionSigns {
    sure: f64,
    sudden: f64,
    /// Packets since the sender had nothing more to send.
    filling: u32,
    round_trips: Option<RoundTrips>,
}

/// The shortest round trip, and the shortest of the last few: a standing queue makes all of them longer, a
/// busy machine only some.
#[derive(Debug, Clone, Copy)]
struct RoundTrips {
    shortest: Duration,
    /// Before the newest few round trips, and of the newest few.
    before: Duration,
    now: Duration,
    count: u32,
}

impl CongestionSigns {
    /// Of a path of which nothing is known.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether a loss now is a sign of congestion.
    #[must_use]
    pub fn are_there(&self) -> bool {
        let random = if self.filling < BURST { RANDOM_LOSS_OF_BURSTS } else { RANDOM_LOSS };
        self.sure > random || self.sudden > SUDDEN || self.round_trips.is_some_and(RoundTrips::queue)
    }

    /// The sender has nothing more to send, though it might send.
    pub fn on_out_of_data(&mut self) {
        self.filling = 0;
    }

    /// A packet has arrived.
    pub fn on_arrived(&mut self) {
        self.count(0.0);
    }

    /// A packet is lost.
    pub fn on_lost(&mut self) {
        self.count(1.0);
    }

    /// A round trip was measured, which took so long.
    pub fn on_round_trip(&mut self, took: Duration) {
        self.round_trips = Some(self.round_trips.map_or(RoundTrips::first(took), |all| all.and(took)));
    }

    /// The path may be another one after persistent congestion (RFC 9002, section 5.2).
    pub fn forget_round_trips(&mut self) {
        self.round_trips = None;
    }

    fn count(&mut self, lost: f64) {
        self.filling = self.filling.saturating_add(1);
        self.sure += (lost - self.sure) / MEMORY;
        self.sudden += (lost - self.sudden) / SUDDEN_MEMORY;
    }
}

impl RoundTrips {
    const fn first(took: Duration) -> Self {
        Self { shortest: took, before: Duration::MAX, now: took, count: 1 }
    }

    fn and(self, took: Duration) -> Self {
        let shortest = self.shortest.min(took);
        match self.count {
            FEW => Self { shortest, before: self.now, ..Self::first(took) },
            _ => Self { shortest, now: self.now.min(took), count: self.count + 1, ..self },
        }
    }

    /// Whether packets queue somewhere on the path: all round trips take longer than they must.
    fn queue(self) -> bool {
        self.before.min(self.now) > self.shortest + (self.shortest / 4).max(SLACK)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// The packets until losses count as congestion, if the first `lost` of each `of` are lost; none if never
    /// within 50,000.
    fn until_congestion(lost: u32, of: u32) -> Option<u32> {
        until_congestion_in_bursts(lost, of, u32::MAX)
    }

    /// The same for a sender that runs out of data after each `burst` packets.
    fn until_congestion_in_bursts(lost: u32, of: u32, burst: u32) -> Option<u32> {
        let mut signs = CongestionSigns::new();
        (0..50_000).find(|packet| {
            if packet % burst == burst - 1 {
                signs.on_out_of_data();
            }
            if packet % of < lost {
                signs.on_lost();
            } else {
                signs.on_arrived();
            }
            signs.are_there()
        })
    }

    #[test]
    fn few_losses_are_accidents_in_a_row_as_well_and_many_are_not() {
        assert_eq!((until_congestion(1, 100), until_congestion(20, 2000)), (None, None));
        // Half of a window at once, or a twentieth for long.
        assert!(until_congestion(1, 2).is_some_and(|packets| packets < 64));
        assert!(until_congestion(1, 20).is_some_and(|packets| (1000..3000).contains(&packets)));
    }

    #[test]
    fn a_sender_that_runs_out_of_data_takes_more_losses_as_accidents() {
        assert!(until_congestion(1, 40).is_some());
        assert_eq!(until_congestion_in_bursts(1, 40, 20), None);
        assert!(until_congestion_in_bursts(1, 40, 2 * BURST).is_some(), "it hardly ever does");
        assert!(until_congestion_in_bursts(1, 12, 20).is_some(), "nobody loses a twelfth by accident");
    }

    #[test]
    fn a_queue_shows_in_longer_round_trips() {
        let mut signs = CongestionSigns::new();
        assert!(!signs.are_there());
        signs.on_round_trip(20 * MS);
        (0..50).for_each(|_| signs.on_round_trip(24 * MS));
        assert!(!signs.are_there());
        (0..2 * FEW).for_each(|_| signs.on_round_trip(27 * MS));
        assert!(signs.are_there());
        signs.on_round_trip(22 * MS);
        (0..FEW).for_each(|_| signs.on_round_trip(60 * MS));
        assert!(!signs.are_there(), "one that was quick shows that nothing stands in the way");
        (0..2 * FEW).for_each(|_| signs.on_round_trip(60 * MS));
        assert!(signs.are_there());
        signs.forget_round_trips();
        assert!(!signs.are_there());
    }
}
