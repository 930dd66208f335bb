//! The share of packets that is lost.

/// The share of losses counts about that many packets: enough that one loss in a hundred is hardly ever taken for two.
const MEMORY: f64 = 1024.0;
/// For repair, which costs little when it comes too early, about so many at first, and later so many.
const FIRST_MEMORY: f64 = 64.0;
const GUESS_MEMORY: f64 = 512.0;

/// The share of packets that was lost lately.
#[derive(Debug)]
pub(super) struct LossShare {
    sure: f64,
    probable: f64,
    /// How many packets the probable share counts.
    memory: f64,
}

impl LossShare {
    pub(super) const fn new() -> Self {
        Self { sure: 0.0, probable: 0.0, memory: FIRST_MEMORY }
    }

    /// By so many packets that few losses do not show.
    pub(super) const fn sure(&self) -> f64 {
        self.sure
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
        self.probable += (lost - self.probable) / self.memory;
        self.memory = (self.memory + 1.0).min(GUESS_MEMORY);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_loss_shows_at_first_and_a_hundredth_is_a_hundredth() {
        let mut share = LossShare::new();
        share.on_lost();
        assert!((share.probable() - 1.0 / FIRST_MEMORY).abs() < 1e-9);
        assert!((share.sure() - 1.0 / MEMORY).abs() < 1e-9);
        for packet in 0..20_000 {
            if packet % 100 == 0 { share.on_lost() } else { share.on_arrived() }
        }
        assert!((share.probable() - 0.01).abs() < 1e-3, "{}", share.probable());
        assert!((share.sure() - 0.01).abs() < 1e-3, "{}", share.sure());
    }
}
