//! The share of lost packets.

/// Up to this share, and while nothing queues, losses count as random loss on the path (as in BBR: section
/// 4.5.2 of draft-ietf-ccwg-bbr).
const RANDOM_LOSS: f64 = 0.02;
/// It is counted over about this many packets: enough that bursts of losses, at one packet in a hundred,
/// hardly ever look like two.
const MEMORY: f64 = 4096.0;
/// Such a share of about so many packets is not random, even after few losses: the window has outgrown the
/// path.
const SUDDEN: f64 = 0.1;
const SUDDEN_MEMORY: f64 = 256.0;
/// For repair, which costs little when it comes too early: about so many packets at first, and later so many.
const FIRST_MEMORY: f64 = 64.0;
const GUESS_MEMORY: f64 = 1024.0;

/// The recent share of lost packets.
#[derive(Debug)]
pub(super) struct LossShare {
    sure: f64,
    sudden: f64,
    probable: f64,
    /// The number of packets in the probable share.
    memory: f64,
}

impl LossShare {
    pub(super) const fn new() -> Self {
        Self { sure: 0.0, sudden: 0.0, probable: 0.0, memory: FIRST_MEMORY }
    }

    /// Whether the losses are too many to be random.
    pub(super) fn is_congestion(&self) -> bool {
        self.sure > RANDOM_LOSS || self.sudden > SUDDEN
    }

    /// From the first loss on, as if one of the first 64 were lost.
    pub(super) const fn probable(&self) -> f64 {
        self.probable
    }

    pub(super) fn on_arrived(&mut self) {
        self.count(0.0);
    }

    pub(super) fn on_lost(&mut self) {
        self.count(1.0);
    }

    fn count(&mut self, lost: f64) {
        self.sure += (lost - self.sure) / MEMORY;
        self.sudden += (lost - self.sudden) / SUDDEN_MEMORY;
        self.probable += (lost - self.probable) / self.memory;
        self.memory = (self.memory + 1.0).min(GUESS_MEMORY);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The packets until losses count as congestion, if the first `lost` of each `of` are lost; none if never
    /// within 50,000.
    fn until_congestion(lost: u32, of: u32) -> Option<u32> {
        let mut share = LossShare::new();
        (0..50_000).find(|packet| {
            if packet % of < lost {
                share.on_lost();
            } else {
                share.on_arrived();
            }
            share.is_congestion()
        })
    }

    #[test]
    fn one_loss_shows_at_first_and_a_hundredth_is_a_hundredth() {
        let mut share = LossShare::new();
        share.on_lost();
        assert!((share.probable() - 1.0 / FIRST_MEMORY).abs() < 1e-9);
        for packet in 0..20_000 {
            if packet % 100 == 0 { share.on_lost() } else { share.on_arrived() }
        }
        assert!((share.probable() - 0.01).abs() < 1e-3, "{}", share.probable());
        assert!((share.sure - 0.01).abs() < 1e-3, "{}", share.sure);
    }

    #[test]
    fn few_losses_are_accidents_in_a_row_as_well_and_many_are_not() {
        assert_eq!((until_congestion(1, 100), until_congestion(20, 2000)), (None, None));
        // Half of a window at once, or a twentieth for long.
        assert!(until_congestion(1, 2).is_some_and(|packets| packets < 64));
        assert!(until_congestion(1, 20).is_some_and(|packets| (1000..3000).contains(&packets)));
    }
}
