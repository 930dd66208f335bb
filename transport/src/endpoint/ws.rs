//! A host, a port and a path for WebSockets.

use std::fmt;
use std::str::FromStr;

use super::{EndpointFault, HostPort};

/// The longest path, bytes.
pub(super) const LONGEST_PATH: usize = 255;

/// A WebSocket address: a host, a port, and a path.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct WsEndpoint {
    /// The host and port.
    pub at: HostPort,
    /// The path.
    pub path: WsPath,
}

/// The path of a WebSocket's address, and its query if it has one: nothing, or `/` and up to 254 characters
/// that need no quoting there (RFC 3986, section 3.3). No path is the same as `/`.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
pub struct WsPath(String);

impl WsPath {
    /// The path as in a request: `/` if it is empty.
    #[must_use]
    pub fn as_str(&self) -> &str {
        if self.0.is_empty() { "/" } else { &self.0 }
    }
}

impl FromStr for WsPath {
    type Err = EndpointFault;

    fn from_str(text: &str) -> Result<Self, EndpointFault> {
        let is_allowed = |b: u8| b.is_ascii_alphanumeric() || b"-._~!$&'()*+,;=:@%/?".contains(&b);
        let begins = text.is_empty() || text.starts_with('/');
        if !begins || text.len() > LONGEST_PATH || !text.bytes().all(is_allowed) {
            return Err(EndpointFault::WsPath);
        }
        Ok(Self(if text == "/" { String::new() } else { text.to_owned() }))
    }
}

impl FromStr for WsEndpoint {
    type Err = EndpointFault;

    /// Parses the part behind `ws://` or `wss://`.
    fn from_str(text: &str) -> Result<Self, EndpointFault> {
        let (at, path) = text.split_at(text.find(['/', '?']).unwrap_or(text.len()));
        Ok(Self { at: at.parse()?, path: path.parse()? })
    }
}

impl fmt::Display for WsEndpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.at, self.path.0)
    }
}

impl From<std::net::SocketAddr> for WsEndpoint {
    fn from(address: std::net::SocketAddr) -> Self {
        Self { at: address.into(), path: WsPath::default() }
    }
}
