//! A host and a port.

use std::fmt;
use std::net::{Ipv4Addr, Ipv6Addr};
use std::str::FromStr;

use super::{EndpointFault, is_plain};

/// The longest host name, bytes (RFC 1035, section 2.3.4).
pub(super) const LONGEST: usize = 253;

/// A host and a port.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct HostPort {
    /// The host.
    pub host: Host,
    /// The port; 0 takes a free one when listening.
    pub port: u16,
}

/// A machine.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Host {
    /// By name.
    Name(HostName),
    /// By an IPv4 address.
    V4(Ipv4Addr),
    /// By an IPv6 address.
    V6(Ipv6Addr),
}

/// A host name: letters, digits, dots, hyphens and underscores, 1 to 253 of them, without a hyphen or a dot
/// at either end.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct HostName(String);

impl FromStr for HostPort {
    type Err = EndpointFault;

    fn from_str(text: &str) -> Result<Self, EndpointFault> {
        let (host, port) = text.rsplit_once(':').ok_or(EndpointFault::NoPort)?;
        let host = match host.strip_prefix('[') {
            Some(v6) => {
                let v6 = v6.strip_suffix(']').ok_or(EndpointFault::NoPort)?;
                Host::V6(v6.parse().map_err(|_| EndpointFault::Host)?)
            }
            None if host.contains(':') => return Err(EndpointFault::NoPort),
            None => host.parse().map(Host::V4).or_else(|_| host.parse().map(Host::Name))?,
        };
        // `u16` alone would accept a sign.
        let digits = !port.is_empty() && port.bytes().all(|b| b.is_ascii_digit());
        let port = port.parse().ok().filter(|_| digits).ok_or(EndpointFault::Port)?;
        Ok(Self { host, port })
    }
}

impl fmt::Display for HostPort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

impl From<std::net::SocketAddr> for HostPort {
    /// The scope of a link-local IPv6 address is lost: name the interface's address instead.
    fn from(address: std::net::SocketAddr) -> Self {
        let host = match address {
            std::net::SocketAddr::V4(v4) => Host::V4(*v4.ip()),
            std::net::SocketAddr::V6(v6) => Host::V6(*v6.ip()),
        };
        Self { host, port: address.port() }
    }
}

impl fmt::Display for Host {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(name) => f.write_str(&name.0),
            Self::V4(address) => address.fmt(f),
            Self::V6(address) => write!(f, "[{address}]"),
        }
    }
}

impl HostName {
    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for HostName {
    type Err = EndpointFault;

    fn from_str(text: &str) -> Result<Self, EndpointFault> {
        let edge = |c: Option<char>| matches!(c, Some('-' | '.') | None);
        // Only digits and dots are a malformed IPv4 address, not a name.
        let numeric = text.chars().all(|c| c.is_ascii_digit() || c == '.');
        let odd = edge(text.chars().next()) || edge(text.chars().next_back()) || numeric;
        if odd || text.len() > LONGEST || !is_plain(text) {
            return Err(EndpointFault::Host);
        }
        Ok(Self(text.to_owned()))
    }
}
