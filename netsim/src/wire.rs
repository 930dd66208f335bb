//! The bytes that machines put on the wire, by layer.

use std::ops::{Add, AddAssign, Sub};

use serde::Serialize;

/// Packets that machines sent, and their bytes by layer; counted once, where they leave the machine.
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
}

impl Add for WireTally {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            packets: self.packets + other.packets,
            payload: self.payload + other.payload,
            transport_headers: self.transport_headers + other.transport_headers,
            ip_headers: self.ip_headers + other.ip_headers,
            link_layer: self.link_layer + other.link_layer,
        }
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
        Self {
            packets: self.packets.saturating_sub(earlier.packets),
            payload: self.payload.saturating_sub(earlier.payload),
            transport_headers: self.transport_headers.saturating_sub(earlier.transport_headers),
            ip_headers: self.ip_headers.saturating_sub(earlier.ip_headers),
            link_layer: self.link_layer.saturating_sub(earlier.link_layer),
        }
    }
}
