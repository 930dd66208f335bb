//! The share of lost packets.

/// Repair costs little when it comes too early: the share is of about so many packets at first, and later of
/// so many.
const FIRST_MEMORY: f64 = 64.0;
const MEMORY: f64 = 1024.0;

/// The recent share of lost packets.
#[derive(Debug)]
pub(super) struct LossShare {
    probable: f64,
    /// The number of packets in it.
    memory: f64,
}

impl LossShare {
    pub(super) const fn new() -> Self {
        Self { probable: 0.0, memory: FIRST_MEMORY }
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
        self.probable += (lost - self.probable) / self.memory;
        self.memory = (self.memory + 1.0).min(MEMORY);
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
        for packet in 0..20_000 {
            if packet % 100 == 0 { share.on_lost() } else { share.on_arrived() }
        }
        assert!((share.probable() - 0.01).abs() < 1e-3, "{}", share.probable());
    }
}
