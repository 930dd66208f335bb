//! Which packets are lost on the way.

use serde::Deserialize;

use super::Probability;
use crate::random::Random;

/// Models of packet loss.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Loss {
    /// No loss.
    #[default]
    None,
    /// Each packet independently, with this probability.
    Independent(Probability),
    /// In bursts.
    GilbertElliott(GilbertElliott),
}

/// Two states, one of which loses (much) more than the other (Gilbert 1960, Elliott 1963); the state changes
/// per packet.
///
/// The state changes per packet and not with time, as in `tc netem`. Where packets are rare a bad spell is
/// long, and retransmissions sent one at a time are lost one after another.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GilbertElliott {
    /// `p`: from the good state to the bad one.
    pub to_bad: Probability,
    /// `r`: from the bad state to the good one. A bad spell lasts `1/r` packets on average.
    pub to_good: Probability,
    /// The share lost in the bad state. Default all.
    #[serde(default = "Probability::one")]
    pub lost_in_bad: Probability,
    /// The share lost in the good state. Default none.
    #[serde(default)]
    pub lost_in_good: Probability,
}

impl GilbertElliott {
    /// The share of packets lost in the long run: `(p lost_in_bad + r lost_in_good) / (p + r)`.
    #[must_use]
    pub fn stationary_loss(&self) -> f64 {
        let (p, r) = (self.to_bad.get(), self.to_good.get());
        if p + r == 0.0 {
            return self.lost_in_good.get();
        }
        (p * self.lost_in_bad.get() + r * self.lost_in_good.get()) / (p + r)
    }
}

/// Decides the loss of each packet. Its random stream is its own, so other settings do not change which
/// packets are lost.
#[derive(Debug)]
pub(super) struct LossProcess {
    random: Random,
    bad: bool,
}

impl LossProcess {
    /// It starts in the good state.
    pub(super) const fn new(random: Random) -> Self {
        Self { random, bad: false }
    }

    pub(super) fn is_lost(&mut self, loss: &Loss) -> bool {
        match loss {
            Loss::None => false,
            Loss::Independent(probability) => self.random.chance(probability.get()),
            Loss::GilbertElliott(model) => {
                let change = if self.bad { model.to_good } else { model.to_bad };
                self.bad ^= self.random.chance(change.get());
                let share = if self.bad { model.lost_in_bad } else { model.lost_in_good };
                self.random.chance(share.get())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn p(value: f64) -> Probability {
        Probability::new(value).unwrap()
    }

    /// The share lost of a million packets, and the mean number lost in a row.
    fn run(loss: &Loss, seed: u64) -> (f64, f64) {
        let mut loss_process = LossProcess::new(Random::stream(0, seed));
        let (mut lost, mut bursts, mut before) = (0_u32, 0_u32, false);
        for _ in 0..1_000_000 {
            let now = loss_process.is_lost(loss);
            lost += u32::from(now);
            bursts += u32::from(now && !before);
            before = now;
        }
        (f64::from(lost) / 1e6, f64::from(lost) / f64::from(bursts))
    }

    #[test]
    fn independent_loss_is_as_frequent_and_as_short_as_it_should() {
        let (share, burst) = run(&Loss::Independent(p(0.03)), 1);
        assert!((share - 0.03).abs() < 0.0007, "{share}");
        assert!((burst - 1.0 / 0.97).abs() < 0.02, "{burst}");
    }

    #[test]
    fn certainty_is_certain() {
        assert_eq!(run(&Loss::Independent(Probability::one()), 1).0, 1.0);
        assert_eq!(run(&Loss::None, 1).0, 0.0);
    }

    #[test]
    fn a_half_lossy_bad_state_and_a_leaky_good_one_add_up() {
        let model =
            GilbertElliott { to_bad: p(0.02), to_good: p(0.2), lost_in_bad: p(0.5), lost_in_good: p(0.001) };
        let (share, _) = run(&Loss::GilbertElliott(model), 5);
        assert!((share - model.stationary_loss()).abs() < 0.001, "{share} {}", model.stationary_loss());
        assert!((model.stationary_loss() - (0.02 * 0.5 + 0.2 * 0.001) / 0.22).abs() < 1e-12);
        let even = GilbertElliott { to_good: p(0.02), ..model };
        assert!((even.stationary_loss() - 0.2505).abs() < 1e-12);
        let for_ever = GilbertElliott { to_good: p(0.0), ..model };
        assert_eq!(for_ever.stationary_loss(), 0.5);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn gilbert_elliott_has_its_stationary_loss_and_mean_burst(to_bad in 0.005..0.1, to_good in 0.1..0.9, seed: u64) {
            let model = GilbertElliott {
                to_bad: p(to_bad), to_good: p(to_good), lost_in_bad: Probability::one(), lost_in_good: p(0.0),
            };
            let (share, burst) = run(&Loss::GilbertElliott(model), seed);
            // Bursts are correlated: their number, not that of the packets, is the sample. Five deviations.
            let bursts = 1e6 * share / burst;
            prop_assert!((share / model.stationary_loss() - 1.0).abs() < 5.0 * 2.0 / bursts.sqrt(), "{} {}", share, model.stationary_loss());
            prop_assert!((burst * to_good - 1.0).abs() < 5.0 / bursts.sqrt(), "{} {}", burst, 1.0 / to_good);
        }
    }
}
