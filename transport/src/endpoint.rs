//! Endpoints: a transport and an address, as one value for a flag or a file.

mod host;
mod local;
mod udp;
mod ws;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use host::{Host, HostName, HostPort};
use local::{LONGEST_NAME, LONGEST_PATH};
pub use local::{Name, SocketPath};
pub use udp::{UdpEndpoint, UdpMode};
use ws::LONGEST_PATH as LONGEST_WS_PATH;
pub use ws::{WsEndpoint, WsPath};

/// A transport and an address: `tcp://host:port`, `udp://host:port`, `quic://host:port`,
/// `ws://host:port/path`, `wss://host:port/path`, `unix:/path` or `inproc:name`. The port of `udp` may be
/// followed by `?mode=reliable` or `?mode=deadline`. The path of `ws` and `wss` may be left out.
///
/// A host is a name, an IPv4 address, or an IPv6 address in brackets. Port 0 takes a free port when
/// listening. [`fmt::Display`] writes text that parses to the same value.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
#[non_exhaustive]
pub enum Endpoint {
    /// TCP connections.
    Tcp(HostPort),
    /// Datagrams of this crate's own protocol.
    Udp(UdpEndpoint),
    /// QUIC (RFC 9000).
    Quic(HostPort),
    /// WebSockets (RFC 6455), as pages in browsers open them.
    Ws(WsEndpoint),
    /// WebSockets over TLS (RFC 8446), to connect to: a proxy or another server listens there.
    Wss(WsEndpoint),
    /// Unix stream sockets: peers on this machine.
    Unix(SocketPath),
    /// Peers in this process.
    Inproc(Name),
    /// A [transport](crate::Transport) from outside this crate.
    Other(OtherEndpoint),
}

/// An endpoint of a [transport](crate::Transport) from outside this crate.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct OtherEndpoint {
    scheme: String,
    address: String,
}

/// Why a text is not an endpoint.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{text:?} is no endpoint: {fault}")]
pub struct EndpointError {
    /// The text.
    pub text: String,
    /// The fault.
    #[source]
    pub fault: EndpointFault,
}

/// The fault of an endpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum EndpointFault {
    /// It has no transport in front.
    #[error(
        "it names no transport; give tcp://host:port, udp://host:port, quic://host:port, ws://host:port/path, \
         wss://host:port/path, unix:/path or inproc:name"
    )]
    Scheme,
    /// It has no port.
    #[error("it has no port; give host:port, with an IPv6 address in brackets: [::1]:7400")]
    NoPort,
    /// The port is not a number of 16 bits.
    #[error("its port is not a number from 0 to 65535")]
    Port,
    /// The host is neither a name nor an address.
    #[error("its host is neither a name nor an IPv4 address nor an IPv6 address in brackets")]
    Host,
    /// The query behind the port.
    #[error("behind its port only ?mode=reliable or ?mode=deadline may follow, and that for udp only")]
    Query,
    /// The path of a WebSocket's address.
    #[error(
        "behind the port of ws or wss may follow / and a path of at most {LONGEST_WS_PATH} letters, digits \
         and -._~!$&'()*+,;=:@%/?"
    )]
    WsPath,
    /// The path of a socket.
    #[error("a socket's path starts with / and has 2 to {LONGEST_PATH} bytes, none of them zero")]
    Path,
    /// The name of a listener within a process.
    #[error("a name has 1 to {LONGEST_NAME} letters, digits, dots, hyphens or underscores")]
    Name,
}

impl Endpoint {
    /// The endpoint of a transport from outside this crate, written `scheme://address`. Only this function
    /// makes such endpoints from text.
    #[must_use]
    pub fn other(scheme: &str, address: &str) -> Self {
        Self::Other(OtherEndpoint { scheme: scheme.to_owned(), address: address.to_owned() })
    }

    /// The transport's name, which is the endpoint's scheme: `tcp`, `udp`, `quic`, `ws`, `wss`, `unix`,
    /// `inproc`, or another.
    #[must_use]
    pub fn transport(&self) -> &str {
        match self {
            Self::Tcp(_) => "tcp",
            Self::Udp(_) => "udp",
            Self::Quic(_) => "quic",
            Self::Ws(_) => "ws",
            Self::Wss(_) => "wss",
            Self::Unix(_) => "unix",
            Self::Inproc(_) => "inproc",
            Self::Other(other) => &other.scheme,
        }
    }

    /// The part behind the scheme, by which transports of byte streams find each other.
    pub(crate) fn address(&self) -> String {
        match self {
            Self::Tcp(at) | Self::Quic(at) => at.to_string(),
            Self::Udp(at) => at.to_string(),
            Self::Ws(at) | Self::Wss(at) => at.to_string(),
            Self::Unix(path) => path.to_string(),
            Self::Inproc(name) => name.to_string(),
            Self::Other(other) => other.address.clone(),
        }
    }

    /// The endpoint of the same transport at another address.
    pub(crate) fn at(&self, address: &str) -> Result<Self, EndpointFault> {
        match self {
            Self::Tcp(_) => address.parse().map(Self::Tcp),
            Self::Quic(_) => address.parse().map(Self::Quic),
            Self::Ws(_) => address.parse().map(Self::Ws),
            Self::Wss(_) => address.parse().map(Self::Wss),
            Self::Udp(at) => address.parse().map(|to| Self::Udp(UdpEndpoint { at: to, mode: at.mode })),
            Self::Unix(_) => address.parse().map(Self::Unix),
            Self::Inproc(_) => address.parse().map(Self::Inproc),
            Self::Other(other) => Ok(Self::other(&other.scheme, address)),
        }
    }

    /// Whether peers authenticate there, so that both need [keys](crate::keys).
    #[must_use]
    pub const fn needs_keys(&self) -> bool {
        matches!(self, Self::Udp(_) | Self::Quic(_))
    }
}

impl FromStr for Endpoint {
    type Err = EndpointError;

    fn from_str(text: &str) -> Result<Self, EndpointError> {
        let parsed = match text.split_once(':') {
            Some(("tcp", rest)) => authority(rest).map(Self::Tcp),
            Some(("udp", rest)) => UdpEndpoint::behind_scheme(rest).map(Self::Udp),
            Some(("quic", rest)) => authority(rest).map(Self::Quic),
            Some(("ws", rest)) => authority(rest).map(Self::Ws),
            Some(("wss", rest)) => authority(rest).map(Self::Wss),
            Some(("unix", path)) => path.parse().map(Self::Unix),
            Some(("inproc", name)) => name.parse().map(Self::Inproc),
            _ => Err(EndpointFault::Scheme),
        };
        parsed.map_err(|fault| EndpointError { text: text.to_owned(), fault })
    }
}

/// The part behind the scheme of a network address.
fn authority<T: FromStr<Err = EndpointFault>>(rest: &str) -> Result<T, EndpointFault> {
    rest.strip_prefix("//").ok_or(EndpointFault::Scheme)?.parse()
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let transport = self.transport();
        match self {
            Self::Tcp(at) | Self::Quic(at) => write!(f, "{transport}://{at}"),
            Self::Udp(at) => write!(f, "{transport}://{at}"),
            Self::Ws(at) | Self::Wss(at) => write!(f, "{transport}://{at}"),
            Self::Unix(path) => write!(f, "{transport}:{path}"),
            Self::Inproc(name) => write!(f, "{transport}:{name}"),
            Self::Other(OtherEndpoint { address, .. }) => write!(f, "{transport}://{address}"),
        }
    }
}

impl TryFrom<String> for Endpoint {
    type Error = EndpointError;

    fn try_from(text: String) -> Result<Self, EndpointError> {
        text.parse()
    }
}

impl From<Endpoint> for String {
    fn from(endpoint: Endpoint) -> Self {
        endpoint.to_string()
    }
}

fn is_plain(text: &str) -> bool {
    text.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'-' | b'_'))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use std::net::Ipv6Addr;

    use super::*;

    fn fault(text: &str) -> EndpointFault {
        text.parse::<Endpoint>().unwrap_err().fault
    }

    #[test]
    fn every_kind_of_endpoint_is_read_and_written() {
        for text in [
            "tcp://localhost:7400",
            "tcp://one.plant.example:0",
            "udp://10.0.0.1:65535",
            "udp://[::1]:7400?mode=deadline",
            "udp://localhost:7400?mode=reliable",
            "quic://[::1]:7400",
            "tcp://[2001:db8::7]:1",
            "ws://localhost:80",
            "ws://[::1]:8080/plant/link?token=a%20b",
            "wss://plant.example:443/link?token=7",
            "unix:/run/trimaran/display.sock",
            "inproc:display",
        ] {
            let endpoint: Endpoint = text.parse().unwrap();
            assert_eq!(endpoint.to_string(), text);
            assert_eq!(text.split_once(':').unwrap().0, endpoint.transport());
        }
        let Ok(Endpoint::Quic(at)) = "quic://[::1]:7400".parse() else { panic!("no address") };
        assert_eq!(at, HostPort { host: Host::V6(Ipv6Addr::LOCALHOST), port: 7400 });
    }

    #[test]
    fn a_bad_endpoint_says_what_is_expected() {
        for text in
            ["", "localhost:7400", "http://a:1", "tcp:a:1", "tcp:/a:1", "TCP://a:1", ":", "10.0.0.1:7400"]
        {
            assert_eq!(fault(text), EndpointFault::Scheme, "{text:?}");
        }
        for text in ["tcp://", "tcp://host", "udp://::1:7400", "tcp://[::1]", "tcp://[::1:7400", "quic://::1"]
        {
            assert_eq!(fault(text), EndpointFault::NoPort, "{text:?}");
        }
        for text in ["tcp://a:", "tcp://a:65536", "tcp://a:-1", "tcp://a:+1", "tcp://a:1 ", "tcp://a:7400/"] {
            assert_eq!(fault(text), EndpointFault::Port, "{text:?}");
        }
        for text in ["udp://a:1?", "udp://a:1?mode=", "udp://a:1?mode=fast", "udp://a:1?deadline=5"] {
            assert_eq!(fault(text), EndpointFault::Query, "{text:?}");
        }
        assert_eq!(fault("tcp://a:1?mode=deadline"), EndpointFault::Port);
        for text in [
            "tcp://:1",
            "tcp://a b:1",
            "tcp://256.0.0.1:1",
            "tcp://[127.0.0.1]:1",
            "tcp://-a:1",
            "tcp://a.:1",
        ] {
            assert_eq!(fault(text), EndpointFault::Host, "{text:?}");
        }
        for text in ["ws://a:1/a b", "ws://a:1/a#b", "ws://a:1?b", "ws://a:1/ü", "wss://a:1?b"] {
            assert_eq!(fault(text), EndpointFault::WsPath, "{text:?}");
        }
        assert_eq!(fault("ws://a/b"), EndpointFault::NoPort);
        for text in ["unix:", "unix:/", "unix:a.sock", "unix:/a/", "unix:/a\0b"] {
            assert_eq!(fault(text), EndpointFault::Path, "{text:?}");
        }
        for text in ["inproc:", "inproc:a b", "inproc://a", "inproc:ä"] {
            assert_eq!(fault(text), EndpointFault::Name, "{text:?}");
        }
        let message = "show:7400".parse::<Endpoint>().unwrap_err().to_string();
        assert!(message.contains("\"show:7400\"") && message.contains("tcp://host:port"), "{message}");
    }

    #[test]
    fn lengths_end_where_the_system_ends() {
        let path = |bytes: usize| format!("unix:/{}", "a".repeat(bytes - 1));
        assert!(path(LONGEST_PATH).parse::<Endpoint>().is_ok());
        assert_eq!(fault(&path(LONGEST_PATH + 1)), EndpointFault::Path);
        let name = |bytes| format!("inproc:{}", "a".repeat(bytes));
        assert!(name(LONGEST_NAME).parse::<Endpoint>().is_ok());
        assert_eq!(fault(&name(LONGEST_NAME + 1)), EndpointFault::Name);
        let ws = |bytes: usize| format!("ws://a:1/{}", "a".repeat(bytes - 1));
        assert!(ws(LONGEST_WS_PATH).parse::<Endpoint>().is_ok());
        assert_eq!(fault(&ws(LONGEST_WS_PATH + 1)), EndpointFault::WsPath);
        let of_host = |bytes| format!("tcp://{}:1", "a".repeat(bytes));
        assert!(of_host(host::LONGEST).parse::<Endpoint>().is_ok());
        assert_eq!(fault(&of_host(host::LONGEST + 1)), EndpointFault::Host);
    }

    proptest! {
        #[test]
        fn whatever_is_read_is_written_the_same(text in "(tcp|udp|quic|wss?|unix|inproc):(//|/)?[a-z0-9:\\[\\]./_-]{0,20}(:[0-9]{1,5})?") {
            if let Ok(endpoint) = text.parse::<Endpoint>() {
                prop_assert_eq!(&endpoint.to_string().parse::<Endpoint>().unwrap(), &endpoint);
            }
        }

        #[test]
        fn any_address_survives(address: std::net::SocketAddr) {
            let endpoint = Endpoint::Tcp(address.into());
            prop_assert_eq!(endpoint.to_string().parse::<Endpoint>().unwrap(), endpoint);
        }

        #[test]
        fn no_text_panics(text in any::<String>()) {
            let _ = text.parse::<Endpoint>();
        }
    }
}
