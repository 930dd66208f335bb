//! How links are made and what they may cost: what all transports have in common, and each one's own.

pub(crate) mod limits;
pub(crate) mod link;
#[cfg(feature = "config")]
pub(crate) mod range;

use std::sync::Arc;

use limits::Limits;
use link::LinkConfig;

#[cfg(feature = "unix")]
use crate::UnixOptions;
#[cfg(feature = "keys")]
use crate::keys::Security;
#[cfg(feature = "quic")]
use crate::quic::QuicOptions;
#[cfg(feature = "udp")]
use crate::udp::UdpOptions;
#[cfg(feature = "ws")]
use crate::ws::WsOptions;
use crate::{TcpOptions, Transport};

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
    /// What holds for WebSockets.
    #[cfg(feature = "ws")]
    pub ws: WsOptions,
    /// Transports beside those of this crate, for endpoints of their schemes. Default none.
    #[cfg_attr(feature = "config", serde(skip))]
    pub transports: Vec<Arc<dyn Transport>>,
}
