//! Peers that a listener has turned away.

use std::fmt;

use prometheus_client::{
    encoding::{DescriptorEncoder, EncodeLabelSet, EncodeMetric},
    metrics::{MetricType, counter::ConstCounter},
};
use serde::{Deserialize, Serialize};
use trimaran_transport::{ListenerStats, TurnedAway};

/// How many peers listeners have turned away since they were made, by limit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TurnedAwayReading {
    /// Handshakes displaced by newer ones, because too many were under way (`handshakes`).
    pub handshakes: u64,
    /// Handshakes beyond the limit of one address per second (`handshakes_per_s_per_address`).
    pub handshakes_per_s_per_address: u64,
    /// Handshakes beyond the limit of all together per second (`handshakes_per_s`).
    pub handshakes_per_s: u64,
    /// Connections of peers beyond the limit (`peers`).
    pub peers: u64,
}

impl TurnedAwayReading {
    /// The sums over these listeners.
    #[must_use]
    pub fn of(listeners: &[ListenerStats]) -> Self {
        let sum = |of: fn(TurnedAway) -> u64| listeners.iter().map(|at| of(at.turned_away())).sum();
        Self {
            handshakes: sum(|away| away.no_room),
            handshakes_per_s_per_address: sum(|away| away.from_address),
            handshakes_per_s: sum(|away| away.in_all),
            peers: sum(|away| away.no_place),
        }
    }

    /// The counts by the name that the limit has in the configuration.
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

/// The limits that were reached: `handshakes 3, peers 2`.
impl fmt::Display for TurnedAwayReading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reached = self.by_limit().into_iter().filter(|(_, count)| *count > 0);
        let reached: Vec<_> = reached.map(|(limit, count)| format!("{limit} {count}")).collect();
        f.write_str(&reached.join(", "))
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Limit {
    limit: &'static str,
}
