//! The share of packets that is lost.

/// Up to that share of losses, and while nothing queues, losses are taken for random loss on the path (as BBR
/// does: section 4.5.2 of draft-ietf-ccwg-bbr).
const RANDOM_LOSS: f64 = 0.02;
/// It is counted over about that many packets: enough that losses in bursts, of one packet in a hundred, are
/// hardly ever taken for two.
const MEMORY: f64 = 4096.0;
/// So large a share of about so many packets is no accident, however few were lost before: the window has
/// grown beyond the path.
const SUDDEN: f64 = 0.1;
const SUDDEN_MEMORY: f64 = 256.0;
/// For repair, which costs little when it comes too early, about so many at first, and later so many.
const FIRST_MEMORY: f64 = 64.0;
const GUESS_MEMORY: f64 = 1024.0;

/// The share of packets that was lost lately.
#[derive(Debug)]
pub(super) struct LossShare {
    sure: f64,
    sudden: f64,
    probable: f64,
    /// How many packets the probable share counts.
    memory: f64,
}

impl LossShare {
    pub(super) const fn new() -> Self {
        Self { sure: 0.0, sudden: 0.0, probable: 0.0, memory: FIRST_MEMORY }
    }

    /// Whether so much is lost that it is no accident.
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

    /// How many packets pass before losses count as congestion, of which the first `lost` of each `of` are
    /// lost; none of 50,000 if never.
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
        // Half of a window, a twentieth for long.
        assert!(until_congestion(1, 2).is_some_and(|packets| packets < 64));
        assert!(until_congestion(1, 20).is_some_and(|packets| (1000..3000).contains(&packets)));
    }
}
