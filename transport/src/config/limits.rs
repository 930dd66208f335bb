//! Limits on the resources that others may use.

/// Limits on the resources of this side that others may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct Limits {
    /// How many peers a listener has links with at once; more are told that it is busy. A peer that connects
    /// again takes the place of its old link. Default 64.
    pub peers: usize,
    /// How many handshakes a listener has open at once. One more takes the slot of the oldest; if an address
    /// holds more than a link takes, that of the address with the most. Default 64.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::config::range::of_a_link"))]
    pub handshakes: usize,
    /// How many handshakes may begin at a listener in a second, over all addresses. More are refused, but
    /// each address may begin its even share. Default 1,000.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::config::range::of_a_link"))]
    pub handshakes_per_s: u32,
    /// The same for one address, an IPv6 network of 64 bits, or over Unix sockets one user. A link over byte
    /// streams takes four. Default 500.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::config::range::of_a_link"))]
    pub handshakes_per_s_per_address: u32,
}

impl Limits {
    trimaran_net::setters! {
        with_peers peers: usize,
        with_handshakes handshakes: usize,
        with_handshakes_per_s handshakes_per_s: u32,
        with_handshakes_per_s_per_address handshakes_per_s_per_address: u32,
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self { peers: 64, handshakes: 64, handshakes_per_s: 1000, handshakes_per_s_per_address: 500 }
    }
}
