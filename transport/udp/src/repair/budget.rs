//! The amount of repair for frames.

use super::{BLOCK, MOST};

/// How often a block may be lost in spite of its repair and wait for a retransmission: half as often as would
/// show at p99.9.
const FAILURES: f64 = 5e-4;
/// If so few blocks are lost with the repair that their own share pays for, it is enough. At 15 packets and
/// two of repair, of which a hundredth is lost, a third shard would cost twenty times as much for each wait
/// that it spares as the second.
const RARE: f64 = 2e-3;
/// Below this share of lost packets a path is clean.
const CLEAN: f64 = 5e-4;
/// The share of losses assumed where repair is always sent.
const EXPECTED: f64 = 0.01;
/// The approximate cost of a packet beside its bytes of a frame: this protocol's fields and tag, the headers
/// of UDP and IPv4, and its share of an acknowledgement.
const BESIDE: usize = 76;
/// A frame of fewer packets is not cut smaller: the packets would cost more than the repair.
const FEW: usize = 7;
/// How many bytes of repair may be saved for later.
const SAVINGS: f64 = 64.0 * 1024.0;

/// When frames get repair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum Repair {
    /// Never: lost data is retransmitted.
    Off,
    /// While packets are lost, as much as their share requires.
    #[default]
    Auto,
    /// Always, on a clean path as if a hundredth of the packets were lost, so that even the first loss costs
    /// no time.
    On,
}

/// The state of the path when data is put into the frames lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Path {
    /// The most bytes of a part: with them a packet is full.
    pub(crate) shard: usize,
    /// The share of lost packets.
    pub(crate) loss: f64,
}

/// The budget for repair: a share of the bytes that would be sent without.
#[derive(Debug, Default)]
pub(crate) struct Budget {
    share: f64,
    saved: f64,
    /// The assumed share of losses.
    expected: f64,
}

impl Budget {
    pub(crate) fn new(when: Repair, percent: u8) -> Self {
        let percent = if when == Repair::Off { 0 } else { percent };
        let expected = if when == Repair::On { EXPECTED } else { 0.0 };
        Self { share: f64::from(percent) / 100.0, saved: 0.0, expected }
    }

    pub(crate) const fn is_open(&self) -> bool {
        self.share > 0.0
    }

    /// So many bytes were retransmitted: losses cost them as well.
    pub(crate) fn on_repeated(&mut self, bytes: usize) {
        self.saved = (self.saved - (bytes + BESIDE) as f64).max(0.0);
    }

    /// The share of losses to repair, if any.
    fn loss(&self, path: Path) -> Option<f64> {
        Some(path.loss.max(self.expected)).filter(|loss| *loss >= CLEAN && self.is_open())
    }

    /// The number of repair shards for a block of `length` bytes, cut into shards of `shard` bytes: as many
    /// as it needs and its share of bytes pays for, or, if those are far too few, the savings of earlier
    /// blocks; but at least one. So a frame of few packets has more than its share; it is small.
    pub(crate) fn spend(&mut self, length: usize, shard: usize, path: Path) -> usize {
        if length == 0 || shard == 0 {
            return 0;
        }
        let cut =
            Cut { length, shards: length.div_ceil(shard), fewest: length.div_ceil(path.shard.max(shard)) };
        let share = cut.plain() * self.share;
        self.saved = (self.saved + share).min(SAVINGS);
        let Some(loss) = self.loss(path) else { return 0 };
        let own = cut.affords(share.min(self.saved)).max(1);
        let is_enough = more_lost_than(own, cut.shards + own, loss) <= RARE;
        let most = if is_enough { own } else { cut.affords(self.saved).max(1) };
        let count = needed(cut.shards, loss).min(most);
        self.saved = (self.saved - cut.cost(count)).max(0.0);
        count
    }

    /// The size of the shards of a frame that will have about `length` bytes: smaller than a packet allows if
    /// that makes the needed repair cheaper, or allows more where not all of it is affordable. Two of 15
    /// shards and their packets are less than two of 12.
    pub(crate) fn shard(&self, length: usize, path: Path) -> usize {
        let fewest = length.div_ceil(path.shard.max(1));
        let Some(loss) = self.loss(path).filter(|_| (FEW..=BLOCK / 2).contains(&fewest)) else {
            return path.shard;
        };
        let judge = |shards: usize| {
            let cut = Cut { length, shards, fewest };
            let count = needed(shards, loss).min(cut.affords(cut.plain() * self.share));
            (more_lost_than(count, shards + count, loss).max(FAILURES), cut.cost(count), shards)
        };
        let best = (fewest..=fewest + fewest / 4)
            .map(judge)
            .min_by(|one, other| one.0.total_cmp(&other.0).then(one.1.total_cmp(&other.1)));
        best.map_or(path.shard, |(.., shards)| length.div_ceil(shards).next_multiple_of(16).min(path.shard))
    }
}

/// A way to cut bytes into shards; with full packets there would be `fewest`.
#[derive(Debug, Clone, Copy)]
struct Cut {
    length: usize,
    shards: usize,
    fewest: usize,
}

impl Cut {
    /// Bytes in full packets without repair.
    fn plain(self) -> f64 {
        (self.length + self.fewest * BESIDE) as f64
    }

    /// The bytes that so many repair shards and the smaller packets cost.
    fn cost(self, repair: usize) -> f64 {
        ((self.shards - self.fewest) * BESIDE + repair * self.shard()) as f64
    }

    /// How many repair shards that many bytes pay for.
    fn affords(self, bytes: f64) -> usize {
        ((bytes - self.cost(0)).max(0.0) / self.shard() as f64) as usize
    }

    /// Bytes of a packet with a repair shard.
    fn shard(self) -> usize {
        self.length.div_ceil(self.shards.max(1)) + BESIDE
    }
}

/// The fewest repair shards with which a block of so many shards is complete except for one time in 2,000, if
/// losses are independent.
fn needed(shards: usize, loss: f64) -> usize {
    (1..MOST).find(|repair| more_lost_than(*repair, shards + repair, loss) <= FAILURES).unwrap_or(MOST)
}

/// The probability that of `all` packets more than `most` are lost.
fn more_lost_than(most: usize, all: usize, loss: f64) -> f64 {
    let keep = 1.0 - loss.min(0.99);
    let mut exactly = keep.powi(all as i32);
    let mut at_most = exactly;
    for lost in 1..=most {
        exactly *= (all - lost + 1) as f64 / lost as f64 * loss / keep;
        at_most += exactly;
    }
    1.0 - at_most
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(shard: usize, loss: f64) -> Path {
        Path { shard, loss }
    }

    #[test]
    fn a_clean_path_has_no_repair_and_a_bad_one_as_much_as_is_allowed() {
        let mut budget = Budget::new(Repair::Auto, 15);
        let mut spend = |shards: usize, loss| budget.spend(shards * 1136, 1136, path(1136, loss));
        assert_eq!(spend(15, 0.0), 0);
        assert_eq!(spend(13, 0.01), 2, "needed");
        for _ in 0..100 {
            spend(15, 0.3);
        }
        let spent: usize = (0..100).map(|_| spend(20, 0.3)).sum();
        assert!((299..=300).contains(&spent), "{spent}: 15 % of 2000");
        let few: usize = (0..100).map(|_| spend(2, 0.01)).sum();
        assert!((100..=101).contains(&few), "a frame of two packets has one of repair: {few}");
        for none in [Budget::new(Repair::Auto, 0), Budget::new(Repair::Off, 15)] {
            assert!(!none.is_open());
        }
    }

    #[test]
    fn what_is_saved_is_for_paths_on_which_the_share_is_far_too_little() {
        let mut budget = Budget::new(Repair::Auto, 15);
        let mut most = |loss| {
            let counts = (0..1000).map(|_| budget.spend(16_080, 1072, path(1376, loss)));
            counts.max()
        };
        assert_eq!((most(0.01), most(0.015), most(0.02)), (Some(2), Some(2), Some(3)));
    }

    #[test]
    fn what_is_sent_again_is_taken_from_the_savings() {
        let third = |repeated: usize| {
            let mut budget = Budget::new(Repair::Auto, 15);
            (0..100).for_each(|_| assert!(budget.spend(16_080, 1072, path(1376, 0.01)) <= 2));
            (0..repeated).for_each(|_| budget.on_repeated(1072));
            budget.spend(16_080, 1072, path(1376, 0.05))
        };
        assert_eq!((third(0), third(1), third(10)), (4, 3, 2));
    }

    #[test]
    fn smaller_packets_count_as_repair() {
        let mut budget = Budget::new(Repair::Auto, 15);
        let (length, shard, full) = (16_080, 1072, path(1376, 0.01));
        let count: usize = (0..100).map(|_| budget.spend(length, shard, full)).sum();
        let spent = count * (shard + BESIDE) + 100 * 3 * BESIDE;
        let all = 100 * (length + 12 * BESIDE);
        assert!(spent * 100 <= all * 15 && spent * 100 > all * 14, "{spent} of {all}");
    }

    #[test]
    fn shards_are_as_small_as_makes_their_repair_affordable() {
        let budget = Budget::new(Repair::Auto, 15);
        // 16 kB: 12 packets at the usual size, of which two of repair would be a sixth.
        assert_eq!(budget.shard(16_080, path(1376, 0.01)), 1072, "15 and two");
        assert_eq!(budget.shard(16_080, path(1136, 0.01)), 1072, "15 alike and two");
        assert_eq!(budget.shard(16_080, path(1376, 0.0021)), 1152, "14 and one, rather than 12 and two");
        assert_eq!(budget.shard(16_080, path(1376, 0.0)), 1376, "a clean path");
        assert_eq!(budget.shard(16_080, path(1376, 0.2)), 1072, "as much as can be had");
        assert_eq!(budget.shard(16_080, path(1376, 0.005)), 1072, "no more than a quarter more packets");
        assert_eq!(budget.shard(4000, path(1376, 0.01)), 1376, "few packets");
        assert_eq!(budget.shard(45_000, path(1376, 0.005)), 1376, "33 packets are many");
        assert_eq!(Budget::new(Repair::Off, 15).shard(16_080, path(1376, 0.01)), 1376);
    }

    #[test]
    fn repair_that_is_always_on_expects_losses_where_there_are_none() {
        assert_eq!(Budget::new(Repair::On, 15).spend(15 * 1136, 1136, path(1136, 0.0)), 2);
        assert_eq!(Budget::new(Repair::On, 0).spend(15 * 1136, 1136, path(1136, 0.0)), 0);
        for (length, shard) in [(0, 1136), (15 * 1136, 0)] {
            assert_eq!(Budget::new(Repair::On, 15).spend(length, shard, path(1136, 0.0)), 0, "nothing");
        }
    }

    #[test]
    fn how_many_are_lost_is_binomial() {
        assert!((more_lost_than(0, 10, 0.1) - (1.0 - 0.9f64.powi(10))).abs() < 1e-12);
        let two = 1.0 - 0.9f64.powi(3) - 3.0 * 0.1 * 0.81;
        assert!((more_lost_than(1, 3, 0.1) - two).abs() < 1e-12);
        assert_eq!((needed(13, 0.01), needed(13, 0.002), needed(64, 0.5)), (2, 1, MOST));
    }
}
