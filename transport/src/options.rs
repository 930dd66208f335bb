//! How links are made and what they may cost: what all transports have in common, and each one's own.

use std::sync::Arc;

#[cfg(feature = "unix")]
use crate::UnixOptions;
#[cfg(feature = "keys")]
use crate::keys::Security;
#[cfg(feature = "quic")]
use crate::quic::QuicOptions;
#[cfg(feature = "udp")]
use crate::udp::UdpOptions;
use crate::{LinkConfig, TcpOptions, Transport};

/// Options of links, whatever their transport.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
pub struct Options {
    /// What holds for a link once it is made.
    pub link: LinkConfig,
    /// What others may make this side spend.
    pub limits: Limits,
    /// This peer's keys and the peers that it knows. What encrypts needs them: QUIC has no plaintext mode.
    /// Default none.
    #[cfg(feature = "keys")]
    #[cfg_attr(feature = "config", serde(skip))]
    pub security: Option<Security>,
    /// What holds for TCP connections.
    pub tcp: TcpOptions,
    /// What holds for Unix sockets.
    #[cfg(feature = "unix")]
    pub unix: UnixOptions,
    /// What holds for QUIC connections.
    #[cfg(feature = "quic")]
    pub quic: QuicOptions,
    /// What holds for connections over datagrams.
    #[cfg(feature = "udp")]
    pub udp: UdpOptions,
    /// Transports beside those of this crate, for endpoints of their schemes. Default none.
    #[cfg_attr(feature = "config", serde(skip))]
    pub transports: Vec<Arc<dyn Transport>>,
}

/// What others may make this side spend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
pub struct Limits {
    /// How many peers a listener has links with at once; more are told that it is busy. Default 16.
    pub peers: usize,
    /// How many handshakes a listener has under way at once. One more takes the slot of the oldest: of the
    /// address that holds most, where one holds more than a link takes. Default 64.
    pub handshakes: usize,
    /// How many handshakes may begin at a listener in a second, by all together. More are turned away,
    /// except that each address may begin its even share. Default 1,000.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::config::above_zero"))]
    pub handshakes_per_s: u32,
    /// And by one address, of IPv6 one network of 64 bits, or over Unix sockets one user. A link over byte
    /// streams takes three. Default 500.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::config::above_zero"))]
    pub handshakes_per_s_per_address: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self { peers: 16, handshakes: 64, handshakes_per_s: 1000, handshakes_per_s_per_address: 500 }
    }
}
