//! The bytes that hosts put on the wire, by layer.

use std::ops::{Add, AddAssign, Sub};

use serde::Serialize;

/// Packets that hosts sent, and their bytes by layer; counted once, where they leave the host.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct WireTally {
    /// How many packets.
    pub packets: u64,
    /// The payload of UDP and TCP.
    pub payload: u64,
    /// The headers of UDP and TCP, options included.
    pub transport_headers: u64,
    /// The headers of IP.
    pub ip_headers: u64,
    /// The bytes added by the link layer.
    pub link_layer: u64,
}

impl WireTally {
    /// All bytes.
    #[must_use]
    pub const fn bytes(&self) -> u64 {
        self.payload + self.headers()
    }

    /// The bytes that are not payload.
    #[must_use]
    pub const fn headers(&self) -> u64 {
        self.transport_headers + self.ip_headers + self.link_layer
    }

    /// Each number of both tallies, joined.
    fn zip(self, other: Self, join: fn(u64, u64) -> u64) -> Self {
        Self {
            packets: join(self.packets, other.packets),
            payload: join(self.payload, other.payload),
            transport_headers: join(self.transport_headers, other.transport_headers),
            ip_headers: join(self.ip_headers, other.ip_headers),
            link_layer: join(self.link_layer, other.link_layer),
        }
    }
}

impl Add for WireTally {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        self.zip(other, u64::add)
    }
}

impl AddAssign for WireTally {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for WireTally {
    type Output = Self;

    /// The difference to the earlier tally `earlier`.
    fn sub(self, earlier: Self) -> Self {
        self.zip(earlier, u64::saturating_sub)
    }
}
