//! What others may make a side spend.

/// What others may make this side spend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
pub struct Limits {
    /// How many peers a listener has links with at once; more are told that it is busy. Who comes again takes
    /// the place of its old link. Default 64.
    pub peers: usize,
    /// How many handshakes a listener has under way at once. One more takes the slot of the oldest: of the
    /// address that holds most, where one holds more than a link takes. Default 64.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::options::range::of_a_link"))]
    pub handshakes: usize,
    /// How many handshakes may begin at a listener in a second, by all together. More are turned away,
    /// except that each address may begin its even share. Default 1,000.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::options::range::of_a_link"))]
    pub handshakes_per_s: u32,
    /// And by one address, of IPv6 one network of 64 bits, or over Unix sockets one user. A link over byte
    /// streams takes four. Default 500.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::options::range::of_a_link"))]
    pub handshakes_per_s_per_address: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self { peers: 64, handshakes: 64, handshakes_per_s: 1000, handshakes_per_s_per_address: 500 }
    }
}
