//! Links for frame-synchronous data over pluggable transports.
//!
//! A [`Link`] joins two peers by two lanes: the *latest* lane is a cell of size one, the *frames* lane
//! carries begin, batches of items, end. An application says what they hold by a [`Protocol`]. [`connect`] and [`Listener`] make them over the transport that
//! an [`Endpoint`] names; using them is the same. [`inproc::pair`] makes two joined links in one process
//! without either.
//!
//! All time, tasks and sockets come through one trait, [`Net`] of `trimaran-net`: [`TokioNet`] is the real
//! one.

mod application;
#[cfg(feature = "conformance")]
pub mod conformance;
mod connect;
mod desk;
mod endpoint;
mod endpoints;
mod error;
mod frames;
mod handshake;
#[cfg(feature = "inproc")]
pub mod inproc;
#[cfg(not(feature = "inproc"))]
#[expect(dead_code, unreachable_pub, reason = "a build without it leads nobody to its lanes")]
mod inproc;
#[cfg(feature = "keys")]
pub mod keys;
mod latest;
mod link;
mod listen;
mod options;
mod patience;
mod pending;
#[cfg(feature = "quic")]
pub mod quic;
mod rates;
mod scheme;
mod stats;
mod stream;
#[cfg(feature = "tcp")]
mod tcp;
mod trace;
mod transport;
#[cfg(feature = "udp")]
pub mod udp;
#[cfg(feature = "unix")]
mod unix;

pub use application::{HelloTooLong, PeerName};
pub use connect::{AttemptError, ConnectError, connect};
pub use endpoint::{
    Endpoint, EndpointError, EndpointFault, Host, HostName, HostPort, Name, OtherEndpoint, SocketPath,
    UdpEndpoint, UdpMode,
};
pub use endpoints::Endpoints;
pub use error::{Loss, ProtocolError, RecvError, SendError};
pub use frames::{FrameEvent, FrameReceiver, FrameSender, FrameStart};
pub use handshake::HandshakeError;
pub use latest::{LatestReceiver, LatestSender};
pub use link::{Capabilities, Link, LinkConfig, PeerAddress, PeerInfo};
pub use listen::{AcceptError, ListenError, Listener};
pub use options::{Limits, Options};
pub use rates::{Door, TooMany, TurnedAway};
pub use stats::{LinkStats, StatsHandle, Tally, Traffic};
pub use transport::{ListenFault, Listening, Transport};
pub use trimaran_net::{
    Credentials, Instant, Keepalive, Net, TcpOptions, TokioNet, UdpSocketOptions, UnixSocketOptions,
    sleep_until, until,
};
#[cfg(feature = "udp")]
pub use trimaran_udp::PathStats;
pub use trimaran_wire::{
    Batch, BatchDecoder, BatchEncoder, BatchError, BatchSize, BatchSizeError, Batching, CloseReason,
    CodingError, DecodeError, DecodeFault, Delivery, Explanation, Fixed, FrameEnd, FrameNumber,
    FrameOrderError, FrameOutcome, FrameViolation, Item, Kind, Lane, Protocol, ProtocolName, Refusal,
    Rejection, SessionId, WireVersion,
};
#[cfg(feature = "unix")]
pub use unix::{ForeignUser, UnixOptions};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
