//! Delivery counts of a link's packets.

use std::ops::{Add, AddAssign, SubAssign};

use serde::Serialize;

/// Packets and the bytes of their frames: headers of all layers and the frame check sequence, without
/// preamble and gap.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Count {
    /// How many packets.
    pub packets: u64,
    /// Their bytes.
    pub bytes: u64,
}

impl Count {
    const fn is_zero(&self) -> bool {
        self.packets == 0
    }
}

impl AddAssign<u32> for Count {
    /// Counts one packet of so many bytes.
    fn add_assign(&mut self, bytes: u32) {
        self.packets += 1;
        self.bytes += u64::from(bytes);
    }
}

impl SubAssign<u32> for Count {
    /// Subtracts one packet of so many bytes.
    fn sub_assign(&mut self, bytes: u32) {
        self.packets -= 1;
        self.bytes -= u64::from(bytes);
    }
}

impl Add for Count {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { packets: self.packets + other.packets, bytes: self.bytes + other.bytes }
    }
}

/// Packets that did not arrive, by cause.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Drops {
    /// Larger than the link's MTU.
    pub mtu: Count,
    /// The queue was full.
    pub queue: Count,
    /// The queue's management dropped them to keep it short.
    pub managed: Count,
    /// Lost on the way.
    pub lost: Count,
    /// Arrived damaged and failed the checksum.
    pub corrupted: Count,
    /// Between two hosts that were partitioned.
    #[serde(skip_serializing_if = "Count::is_zero")]
    pub partitioned: Count,
    /// In the queue of a host that crashed, or for a host that was down.
    #[serde(skip_serializing_if = "Count::is_zero")]
    pub down: Count,
}

impl Drops {
    /// All of them.
    #[must_use]
    pub fn total(&self) -> Count {
        self.mtu + self.queue + self.managed + self.lost + self.corrupted + self.partitioned + self.down
    }
}

/// Delivery counts of one direction of a link.
///
/// At any time `offered + duplicated = delivered + dropped + queued + flying`, in packets and in bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct LinkTally {
    /// Handed to the link.
    pub offered: Count,
    /// Copies that the link made.
    pub duplicated: Count,
    /// Came out at the other end.
    pub delivered: Count,
    /// Dropped, by cause.
    pub dropped: Drops,
    /// Waiting in the queue.
    pub queued: Count,
    /// Being sent or in flight.
    pub flying: Count,
    /// Marked "congestion experienced" rather than dropped, also by a link before; also counted under their
    /// outcome.
    pub marked: Count,
}

impl LinkTally {
    /// Whether every packet is accounted for.
    #[must_use]
    pub fn is_balanced(&self) -> bool {
        self.offered + self.duplicated == self.delivered + self.dropped.total() + self.queued + self.flying
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_that_is_nowhere_unbalances_a_tally() {
        let one = Count { packets: 1, bytes: 100 };
        assert!(Count::default().is_zero() && !one.is_zero());
        assert_eq!(one + one, Count { packets: 2, bytes: 200 });
        let offered = LinkTally { offered: one, ..LinkTally::default() };
        assert!(LinkTally::default().is_balanced() && !offered.is_balanced());
        let none = Drops::default();
        for dropped in [
            Drops { mtu: one, ..none },
            Drops { queue: one, ..none },
            Drops { managed: one, ..none },
            Drops { lost: one, ..none },
            Drops { corrupted: one, ..none },
            Drops { partitioned: one, ..none },
            Drops { down: one, ..none },
        ] {
            assert!(LinkTally { dropped, ..offered }.is_balanced());
        }
        for tally in [
            LinkTally { delivered: one, ..offered },
            LinkTally { queued: one, ..offered },
            LinkTally { flying: one, ..offered },
        ] {
            assert!(tally.is_balanced());
            assert!(!LinkTally { duplicated: one, ..tally }.is_balanced());
        }
    }
}
