//! What a listener has turned away.

use std::{fmt, iter::Sum, ops::Add};

use prometheus_client::{
    encoding::{DescriptorEncoder, EncodeLabelSet, EncodeMetric},
    metrics::{MetricType, counter::ConstCounter},
};
use serde::{Deserialize, Serialize};
use trimaran_transport::TurnedAway;

/// What listeners have turned away since they were made, by which limit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TurnedAwayReading {
    /// Handshakes that gave way to newer ones, because too many were under way (`handshakes`).
    pub handshakes: u64,
    /// Handshakes beyond what one address may begin in a second (`handshakes_per_s_per_address`).
    pub handshakes_per_s_per_address: u64,
    /// Handshakes beyond what all together may begin in a second (`handshakes_per_s`).
    pub handshakes_per_s: u64,
    /// Connections of peers for which there was no place (`peers`).
    pub peers: u64,
}

impl TurnedAwayReading {
    /// The counts by the limit that was reached, as the limits are called where they are set.
    #[must_use]
    pub const fn by_limit(&self) -> [(&'static str, u64); 4] {
        [
            ("handshakes", self.handshakes),
            ("handshakes_per_s_per_address", self.handshakes_per_s_per_address),
            ("handshakes_per_s", self.handshakes_per_s),
            ("peers", self.peers),
        ]
    }

    /// Writes the family.
    pub(super) fn encode(&self, encoder: &mut DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
        let help = "Handshakes and peers turned away by the limit that was reached";
        let mut family = encoder.encode_descriptor("turned_away", help, None, MetricType::Counter)?;
        for (limit, count) in self.by_limit() {
            ConstCounter::new(count).encode(family.encode_family(&Limit { limit })?)?;
        }
        Ok(())
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Limit {
    limit: &'static str,
}

impl From<TurnedAway> for TurnedAwayReading {
    fn from(TurnedAway { no_room, from_address, in_all, no_place }: TurnedAway) -> Self {
        Self {
            handshakes: no_room,
            handshakes_per_s_per_address: from_address,
            handshakes_per_s: in_all,
            peers: no_place,
        }
    }
}

impl Add for TurnedAwayReading {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            handshakes: self.handshakes + other.handshakes,
            handshakes_per_s_per_address: self.handshakes_per_s_per_address
                + other.handshakes_per_s_per_address,
            handshakes_per_s: self.handshakes_per_s + other.handshakes_per_s,
            peers: self.peers + other.peers,
        }
    }
}

impl Sum for TurnedAwayReading {
    fn sum<I: Iterator<Item = Self>>(readings: I) -> Self {
        readings.fold(Self::default(), Add::add)
    }
}
