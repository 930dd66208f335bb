//! The peer of a link, and its address.

use std::fmt;
use std::net::SocketAddr;
use std::sync::Arc;

use bytes::Bytes;
use trimaran_net::{Credentials, StreamPeer};
use trimaran_wire::{Batching, Protocol, SessionId, WireVersion};

/// The peer of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct PeerInfo<P: Protocol> {
    /// Its name in messages and logs.
    pub name: PeerName,
    /// Its hello.
    pub hello: P::Hello,
    /// The link's session id.
    pub session: SessionId,
    /// Its address when the link was made: over datagrams and QUIC it may change.
    pub address: PeerAddress,
    /// The version of the wire that the link has: the highest that both sides speak.
    pub version: WireVersion,
}

/// The name of a peer in messages and logs, from its application.
#[derive(Clone, PartialEq, Eq)]
pub struct PeerName(Arc<str>);

impl PeerName {
    pub(crate) fn new(name: &str) -> Self {
        Self(name.into())
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for PeerName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl fmt::Debug for PeerName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// A peer, from its hello.
#[derive(Debug, Clone)]
pub struct Peer {
    pub(crate) hello: Bytes,
    pub(crate) name: PeerName,
    /// The version of the link's wire.
    pub(crate) version: WireVersion,
    /// The role that it claims. Transports with keys check it against its key.
    pub(crate) role: Option<String>,
    /// The identity by which a listener recognizes it when it connects again.
    pub(crate) place: Option<u64>,
    /// How items travel, if the hellos of both sides decide it.
    pub(crate) batching: Option<Batching>,
}

impl Peer {
    /// Its name.
    #[must_use]
    pub const fn name(&self) -> &PeerName {
        &self.name
    }

    /// The role that it claims.
    #[must_use]
    pub fn role(&self) -> Option<&str> {
        self.role.as_deref()
    }
}

/// The address of a peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PeerAddress {
    /// In this process.
    InProcess,
    /// At the other end of TCP connections; the port is that of the frames lane.
    Tcp(SocketAddr),
    /// At the other end of Unix sockets of this machine.
    Unix(Credentials),
    /// Behind datagrams of this crate's own protocol.
    Udp(SocketAddr),
    /// At the other end of a QUIC connection.
    Quic(SocketAddr),
    /// At the other end of byte streams of a [`Transport`](crate::Transport) from outside this crate.
    Other {
        /// The transport's scheme.
        scheme: &'static str,
        /// The address, from the transport.
        at: StreamPeer,
    },
}

impl PeerAddress {
    /// The peer of a byte stream of the transport `scheme`.
    pub(crate) fn over(scheme: &'static str, peer: StreamPeer) -> Self {
        match (scheme, peer) {
            ("tcp", StreamPeer::Tcp(at)) => Self::Tcp(at),
            ("unix", StreamPeer::Unix(process)) => Self::Unix(process),
            (scheme, at) => Self::Other { scheme, at },
        }
    }

    /// The peer's transport, as [`Endpoint::transport`](crate::Endpoint::transport) names it.
    #[must_use]
    pub const fn transport(&self) -> &'static str {
        match self {
            Self::InProcess => "inproc",
            Self::Tcp(_) => "tcp",
            Self::Unix(_) => "unix",
            Self::Udp(_) => "udp",
            Self::Quic(_) => "quic",
            Self::Other { scheme, .. } => scheme,
        }
    }
}

impl fmt::Display for PeerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::InProcess => f.write_str("this process"),
            Self::Tcp(address)
            | Self::Udp(address)
            | Self::Quic(address)
            | Self::Other { at: StreamPeer::Tcp(address), .. } => address.fmt(f),
            Self::Unix(process) | Self::Other { at: StreamPeer::Unix(process), .. } => match process {
                Credentials { uid, pid: Some(pid), .. } => write!(f, "process {pid} of user {uid}"),
                Credentials { uid, pid: None, .. } => write!(f, "a process of user {uid}"),
            },
        }
    }
}
