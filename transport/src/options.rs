//! How links are made and what they may cost: what all transports have in common, and each one's own.

use std::time::Duration;

use crate::keys::Security;
use crate::quic::QuicOptions;
use crate::udp::UdpOptions;
use crate::{LinkConfig, TcpOptions, UnixOptions};

/// Options of links, whatever their transport.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// What holds for a link once it is made.
    pub link: LinkConfig,
    /// How long one handshake may take, from the connection to the last answer. Default 5 s.
    pub handshake: Duration,
    /// What others may make this side spend.
    pub limits: Limits,
    /// This peer's keys and the peers that it knows. What encrypts needs them: QUIC has no plaintext mode.
    /// Default none.
    pub security: Option<Security>,
    /// What holds for TCP connections.
    pub tcp: TcpOptions,
    /// What holds for Unix sockets.
    pub unix: UnixOptions,
    /// What holds for QUIC connections.
    pub quic: QuicOptions,
    /// What holds for connections over datagrams.
    pub udp: UdpOptions,
}

/// What others may make this side spend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// How many peers a listener has links with at once; more are told that it is busy. Default 16.
    pub peers: usize,
    /// How many handshakes a listener has under way at once. One more takes the slot of the oldest: of the
    /// address that holds most, where one holds more than a link takes. Default 64.
    pub handshakes: usize,
    /// How many handshakes may begin at a listener in a second, by all together. More are turned away,
    /// except that each address may begin its even share. Default 1,000.
    pub handshakes_per_s: u32,
    /// And by one address, of IPv6 one network of 64 bits, or over Unix sockets one user. A link over byte
    /// streams takes two. Default 500.
    pub handshakes_per_s_per_address: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            link: LinkConfig::default(),
            handshake: Duration::from_secs(5),
            limits: Limits::default(),
            security: None,
            tcp: TcpOptions::default(),
            unix: UnixOptions::default(),
            quic: QuicOptions::default(),
            udp: UdpOptions::default(),
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self { peers: 16, handshakes: 64, handshakes_per_s: 1000, handshakes_per_s_per_address: 500 }
    }
}
