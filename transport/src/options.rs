//! Options of links: those common to all transports, and those of each.

use std::sync::Arc;

#[cfg(feature = "unix")]
use crate::UnixOptions;
use crate::config::limits::Limits;
use crate::config::link::LinkConfig;
#[cfg(feature = "keys")]
use crate::keys::Security;
#[cfg(feature = "quic")]
use crate::quic::QuicOptions;
#[cfg(feature = "udp")]
use crate::udp::UdpOptions;
#[cfg(feature = "ws")]
use crate::ws::WsOptions;
use crate::{LaneTransport, TcpOptions, Transport};

/// Options of links over any transport.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct Options {
    /// Options of a link once it is made.
    pub link: LinkConfig,
    /// Limits on the resources of this side that others may use.
    pub limits: Limits,
    /// This peer's keys and the peers that it knows. Encrypted transports need them: QUIC has no plaintext
    /// mode. Default none.
    #[cfg(feature = "keys")]
    #[cfg_attr(feature = "config", serde(skip))]
    pub security: Option<Security>,
    /// Options of TCP connections.
    pub tcp: TcpOptions,
    /// Options of Unix sockets.
    #[cfg(feature = "unix")]
    pub unix: UnixOptions,
    /// Options of QUIC connections.
    #[cfg(feature = "quic")]
    pub quic: QuicOptions,
    /// Options of connections over datagrams.
    #[cfg(feature = "udp")]
    pub udp: UdpOptions,
    /// Options of WebSockets.
    #[cfg(feature = "ws")]
    pub ws: WsOptions,
    /// Transports beside those of this crate, for endpoints of their schemes. Default none.
    #[cfg_attr(feature = "config", serde(skip))]
    pub transports: Vec<Arc<dyn Transport>>,
    /// The same for transports with lanes of their own. Default none.
    #[cfg_attr(feature = "config", serde(skip))]
    pub lane_transports: Vec<Arc<dyn LaneTransport>>,
}

impl Options {
    trimaran_net::setters! {
        with_link link: LinkConfig,
        with_limits limits: Limits,
        with_tcp tcp: TcpOptions,
        with_transports transports: Vec<Arc<dyn Transport>>,
        with_lane_transports lane_transports: Vec<Arc<dyn LaneTransport>>,
    }
    #[cfg(feature = "unix")]
    trimaran_net::setters! { with_unix unix: UnixOptions }
    #[cfg(feature = "quic")]
    trimaran_net::setters! { with_quic quic: QuicOptions }
    #[cfg(feature = "udp")]
    trimaran_net::setters! { with_udp udp: UdpOptions }
    #[cfg(feature = "ws")]
    trimaran_net::setters! { with_ws ws: WsOptions }

    /// The same with this [`security`](Self::security).
    #[cfg(feature = "keys")]
    #[must_use]
    pub fn with_security(mut self, security: impl Into<Option<Security>>) -> Self {
        self.security = security.into();
        self
    }
}
