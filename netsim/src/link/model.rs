//! The model of a link, as data.

use std::str::FromStr;
use std::time::Duration;

use serde::Deserialize;
use thiserror::Error;
use trimaran_net::Instant;

use super::{Jitter, Loss, QueueModel};

/// One direction of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkModel {
    /// The conditions at first.
    pub conditions: Conditions,
    /// The conditions from later times on, by rising time.
    pub phases: Vec<Phase>,
    /// The phases repeat after this time.
    pub repeat: Option<Duration>,
    /// The queue before the link.
    pub queue: QueueModel,
    /// The largest IP packet, bytes.
    pub mtu: u32,
    /// The bytes that the link layer adds to an IP packet.
    pub framing: Framing,
}

/// The conditions of a link, which may change while it is in use.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Conditions {
    /// Bits a second; without one, sending takes no time.
    pub rate: Option<Rate>,
    /// The propagation delay.
    pub delay: Duration,
    /// The variation of the delay.
    pub jitter: Option<Jitter>,
    /// Which packets are lost.
    pub loss: Loss,
    /// The share of packets that arrive damaged; checksums find them, so they are lost at the far end.
    pub corrupt: Probability,
    /// The share of packets that arrive twice.
    pub duplicate: Probability,
    /// Which packets are delayed so that others overtake them.
    pub reorder: Option<Reorder>,
}

/// Conditions from a time on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phase {
    /// The time since the start of the simulation, or of the repetition.
    pub at: Duration,
    /// The conditions from then on.
    pub conditions: Conditions,
}

/// Reordering: some packets take longer.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reorder {
    /// The share of such packets.
    pub share: Probability,
    /// Their additional delay.
    #[serde(deserialize_with = "crate::text::duration")]
    pub by: Duration,
}

/// The bytes that a link layer adds to an IP packet.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Framing {
    /// Ethernet (IEEE 802.3): a header of 14 bytes and a check sequence of 4, at least 64 in all. On the line
    /// 8 more before and a gap of 12 after each frame take time, but do not count as bytes sent.
    #[default]
    Ethernet,
    /// A fixed number of bytes a packet.
    Bytes(u32),
}

impl Framing {
    /// The bytes of the frame around an IP packet.
    #[must_use]
    pub fn frame_bytes(self, ip_bytes: u32) -> u32 {
        match self {
            Self::Ethernet => (14 + ip_bytes + 4).max(64),
            Self::Bytes(bytes) => ip_bytes + bytes,
        }
    }

    /// The length of the frame on the line in bytes, which decides its time.
    #[must_use]
    pub fn line_bytes(self, ip_bytes: u32) -> u32 {
        match self {
            Self::Ethernet => self.frame_bytes(ip_bytes) + 8 + 12,
            Self::Bytes(_) => self.frame_bytes(ip_bytes),
        }
    }
}

impl LinkModel {
    /// A link of this rate and delay with an unlimited queue and no impairments.
    #[must_use]
    pub fn clean(rate: Option<Rate>, delay: Duration) -> Self {
        Self {
            conditions: Conditions { rate, delay, ..Conditions::default() },
            phases: Vec::new(),
            repeat: None,
            queue: QueueModel { packets: u32::MAX, ..QueueModel::default() },
            mtu: 1500,
            framing: Framing::Ethernet,
        }
    }

    /// The conditions at a time.
    #[must_use]
    pub fn conditions_at(&self, now: Instant) -> &Conditions {
        if self.phases.is_empty() {
            return &self.conditions;
        }
        let since_start = u128::from(now.as_nanos());
        let time = match self.repeat.map(|period| period.as_nanos()) {
            Some(period) if period > 0 => since_start % period,
            _ => since_start,
        };
        let past = self.phases.partition_point(|phase| phase.at.as_nanos() <= time);
        past.checked_sub(1)
            .and_then(|index| self.phases.get(index))
            .map_or(&self.conditions, |phase| &phase.conditions)
    }
}

/// Between 0 and 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, PartialOrd, Deserialize)]
#[serde(try_from = "f64")]
pub struct Probability(f64);

/// A number that is not a probability.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("{0} is no probability: give a number from 0 to 1, such as 0.01 for one in a hundred")]
pub struct ProbabilityError(f64);

impl Probability {
    /// A probability.
    ///
    /// # Errors
    /// When `value` is not within 0 and 1.
    pub fn new(value: f64) -> Result<Self, ProbabilityError> {
        if (0.0..=1.0).contains(&value) { Ok(Self(value)) } else { Err(ProbabilityError(value)) }
    }

    /// Certainty.
    #[must_use]
    pub const fn one() -> Self {
        Self(1.0)
    }

    /// The number.
    #[must_use]
    pub const fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for Probability {
    type Error = ProbabilityError;

    fn try_from(value: f64) -> Result<Self, ProbabilityError> {
        Self::new(value)
    }
}

/// Bits a second; above 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(try_from = "String")]
pub struct Rate(u64);

/// A text that is not a rate.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "{text:?} is no rate: give a number above 0 and bit/s, kbit/s, Mbit/s or Gbit/s, such as \"100 Mbit/s\""
)]
pub struct RateError {
    /// The text.
    pub text: String,
}

/// Units of rates, the largest first.
const RATE_UNITS: [(&str, u64); 4] =
    [("Gbit/s", 1_000_000_000), ("Mbit/s", 1_000_000), ("kbit/s", 1000), ("bit/s", 1)];

impl Rate {
    /// So many bits a second; `None` for 0.
    #[must_use]
    pub const fn new(bits_per_second: u64) -> Option<Self> {
        if bits_per_second == 0 { None } else { Some(Self(bits_per_second)) }
    }

    /// Bits a second.
    #[must_use]
    pub const fn bits_per_second(self) -> u64 {
        self.0
    }
}

impl FromStr for Rate {
    type Err = RateError;

    fn from_str(text: &str) -> Result<Self, RateError> {
        let error = || RateError { text: text.to_owned() };
        let (number, unit) = RATE_UNITS
            .iter()
            .find_map(|(name, unit)| text.strip_suffix(name).map(|number| (number, *unit)))
            .ok_or_else(error)?;
        let number: f64 = number.trim_end().parse().map_err(|_| error())?;
        let bits = number * unit as f64;
        if (1.0..=1e15).contains(&bits) { Ok(Self(libm::round(bits) as u64)) } else { Err(error()) }
    }
}

impl TryFrom<String> for Rate {
    type Error = RateError;

    fn try_from(text: String) -> Result<Self, RateError> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_with_a_period_of_zero_do_not_repeat() {
        let fast = LinkModel::clean(None, Duration::ZERO);
        let slow = Conditions { delay: Duration::from_secs(1), ..fast.conditions };
        let phases = vec![Phase { at: Duration::from_secs(2), conditions: slow }];
        let delays = |repeat| {
            let model = LinkModel { phases: phases.clone(), repeat, ..fast.clone() };
            [1, 2, 3, 4].map(|s| model.conditions_at(Instant::from_nanos(s * 1_000_000_000)).delay.as_secs())
        };
        assert_eq!(delays(None), [0, 1, 1, 1]);
        assert_eq!(delays(Some(Duration::from_secs(3))), [0, 1, 0, 0]);
        assert_eq!(delays(Some(Duration::ZERO)), [0, 1, 1, 1]);
    }

    #[test]
    fn ethernet_counts_frames_and_times_lines() {
        assert_eq!(Framing::Ethernet.frame_bytes(1500), 1518);
        assert_eq!(Framing::Ethernet.line_bytes(1500), 1538);
        assert_eq!(Framing::Ethernet.frame_bytes(40), 64, "short packets are padded");
        assert_eq!(Framing::Bytes(8).line_bytes(1500), 1508);
    }

    #[test]
    fn rates_are_read_with_their_units() {
        for (text, bits) in
            [("100 Mbit/s", 100_000_000), ("1Gbit/s", 1_000_000_000), ("2.5 kbit/s", 2500), ("1 bit/s", 1)]
        {
            assert_eq!(text.parse::<Rate>().unwrap().bits_per_second(), bits);
        }
        for text in ["", "100", "100 Mb/s", "-1 Mbit/s", "0 Mbit/s", "NaN Mbit/s", "1e300 Gbit/s", "Mbit/s"] {
            assert!(text.parse::<Rate>().is_err(), "{text:?} was taken");
        }
    }

    #[test]
    fn probabilities_stay_between_0_and_1() {
        for bad in [-0.1, 1.1, f64::NAN, f64::INFINITY] {
            assert!(Probability::new(bad).is_err(), "{bad} was taken");
        }
        assert_eq!(Probability::new(1.0), Ok(Probability::one()));
    }

    #[test]
    fn phases_follow_one_another_and_repeat() {
        let rate =
            |megabits: u64| Conditions { rate: Rate::new(megabits * 1_000_000), ..Conditions::default() };
        let phase =
            |seconds, megabits| Phase { at: Duration::from_secs(seconds), conditions: rate(megabits) };
        let mut link = LinkModel::clean(Rate::new(9_000_000), Duration::ZERO);
        link.phases = vec![phase(2, 2), phase(5, 5)];
        let at = |link: &LinkModel, millis: u64| {
            link.conditions_at(Instant::from_nanos(millis * 1_000_000)).rate.unwrap().bits_per_second()
                / 1_000_000
        };
        assert_eq!([0, 1999, 2000, 4999, 5000, 60_000].map(|t| at(&link, t)), [9, 9, 2, 2, 5, 5]);
        link.repeat = Some(Duration::from_secs(6));
        assert_eq!([5999, 6000, 8000, 11_000].map(|t| at(&link, t)), [5, 9, 2, 5]);
    }
}
