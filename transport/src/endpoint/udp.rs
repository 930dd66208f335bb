//! A host and a port for datagrams, and the mode of sending frames there.

use std::fmt;

use super::{EndpointFault, HostPort, authority};

/// A host and a port, and the mode of sending frames there.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct UdpEndpoint {
    /// The host and port.
    pub at: HostPort,
    /// The mode for late frames; by default that of the [options](crate::udp::UdpOptions).
    pub mode: Option<UdpMode>,
}

/// The mode for frames that this side sends over datagrams when packets are lost. Each side has its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum UdpMode {
    /// Every frame arrives complete, or the link ends.
    #[default]
    Reliable,
    /// Data that cannot arrive within the options' deadline is given up: the receiver gets a frame with gaps
    /// that is marked so.
    Deadline,
}

impl UdpEndpoint {
    /// Parses the part behind the scheme.
    pub(super) fn behind_scheme(rest: &str) -> Result<Self, EndpointFault> {
        let (at, mode) = match rest.split_once('?') {
            None => (rest, None),
            Some((at, "mode=reliable")) => (at, Some(UdpMode::Reliable)),
            Some((at, "mode=deadline")) => (at, Some(UdpMode::Deadline)),
            Some(_) => return Err(EndpointFault::Query),
        };
        Ok(Self { at: authority(at)?, mode })
    }
}

impl fmt::Display for UdpEndpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.at.fmt(f)?;
        match self.mode {
            None => Ok(()),
            Some(UdpMode::Reliable) => f.write_str("?mode=reliable"),
            Some(UdpMode::Deadline) => f.write_str("?mode=deadline"),
        }
    }
}

impl From<std::net::SocketAddr> for UdpEndpoint {
    fn from(address: std::net::SocketAddr) -> Self {
        Self { at: address.into(), mode: None }
    }
}
