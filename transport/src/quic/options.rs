//! How QUIC connections are set up.

use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use quinn::congestion::{BbrConfig, CubicConfig, NewRenoConfig};
use quinn::{IdleTimeout, MtuDiscoveryConfig, TransportConfig, VarInt};
use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_proto::NumberedCamera;

use crate::{LinkConfig, UdpSocketOptions};

/// Room for the one camera that waits to be sent: the next one takes its place. quinn counts 32 bytes of its own a datagram.
const DATAGRAM_ROOM: usize = NumberedCamera::SIZE + size_of::<bytes::Bytes>();
/// How many cameras may wait for their reader; the oldest go first.
const CAMERAS: usize = 16;

/// Options of QUIC connections.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuicOptions {
    /// How the connection shares the way with others. Default cubic.
    pub congestion: Congestion,
    /// What the first packets take the round trip to be, before it is measured: a third of the pause after which they are
    /// sent again. Default 100 ms.
    pub initial_rtt: Duration,
    /// How many bytes may be under way in each direction, sent and not read. Default 8 MiB.
    pub window: u32,
    /// How many frames may be under way in each direction. Default 64.
    pub frames: u32,
    /// Hands the system several packets at once (GSO) where it can cut them up. A loss may then take several. Default true.
    pub segmentation: bool,
    /// Probes for the largest packets that the way takes. Default true.
    pub mtu_discovery: bool,
    /// The UDP socket.
    pub socket: UdpSocketOptions,
}

/// Which congestion control a connection has.
///
/// As text `cubic`, `bbr` or `new-reno`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
#[non_exhaustive]
pub enum Congestion {
    /// CUBIC (RFC 9438), as most TCP has it.
    #[default]
    Cubic,
    /// BBR: by measured bandwidth rather than by loss. Experimental in quinn.
    Bbr,
    /// New Reno (RFC 9002, section 7).
    NewReno,
}

/// A text that names no congestion control.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0:?} is no congestion control: give cubic, bbr or new-reno")]
pub struct CongestionError(String);

impl Congestion {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::Cubic, Self::Bbr, Self::NewReno];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cubic => "cubic",
            Self::Bbr => "bbr",
            Self::NewReno => "new-reno",
        }
    }
}

impl FromStr for Congestion {
    type Err = CongestionError;

    fn from_str(name: &str) -> Result<Self, CongestionError> {
        let found = Self::ALL.into_iter().find(|congestion| congestion.name() == name);
        found.ok_or_else(|| CongestionError(name.to_owned()))
    }
}

impl TryFrom<String> for Congestion {
    type Error = CongestionError;

    fn try_from(name: String) -> Result<Self, CongestionError> {
        name.parse()
    }
}

impl From<Congestion> for String {
    fn from(congestion: Congestion) -> Self {
        congestion.name().to_owned()
    }
}

impl Default for QuicOptions {
    fn default() -> Self {
        Self {
            congestion: Congestion::default(),
            initial_rtt: Duration::from_millis(100),
            window: 8 << 20,
            frames: 64,
            segmentation: true,
            mtu_discovery: true,
            socket: UdpSocketOptions::default(),
        }
    }
}

impl QuicOptions {
    pub(crate) fn transport(&self, link: &LinkConfig) -> Arc<TransportConfig> {
        let mut config = TransportConfig::default();
        // A hundred years of silence are as good as for ever.
        let idle = IdleTimeout::try_from(link.lease).ok();
        config
            .max_idle_timeout(idle)
            .keep_alive_interval(Some(link.keepalive()))
            .initial_rtt(self.initial_rtt)
            .stream_receive_window(VarInt::from_u32(self.window))
            .receive_window(VarInt::from_u32(self.window))
            .send_window(self.window.into())
            .max_concurrent_bidi_streams(VarInt::from_u32(1))
            .max_concurrent_uni_streams(VarInt::from_u32(self.frames))
            .datagram_send_buffer_size(DATAGRAM_ROOM)
            .datagram_receive_buffer_size(Some(DATAGRAM_ROOM * CAMERAS))
            .enable_segmentation_offload(self.segmentation)
            .mtu_discovery_config(self.mtu_discovery.then(MtuDiscoveryConfig::default));
        match self.congestion {
            Congestion::Cubic => config.congestion_controller_factory(Arc::new(CubicConfig::default())),
            Congestion::Bbr => config.congestion_controller_factory(Arc::new(BbrConfig::default())),
            Congestion::NewReno => config.congestion_controller_factory(Arc::new(NewRenoConfig::default())),
        };
        Arc::new(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_congestion_control_goes_by_its_name() {
        for congestion in Congestion::ALL {
            assert_eq!(congestion.name().parse(), Ok(congestion));
        }
        let error = "reno".parse::<Congestion>().unwrap_err().to_string();
        assert!(error.contains("new-reno"), "{error}");
    }
}
