//! Links for data that belongs to frames, over pluggable transports and an application's own types.
//!
//! A [`Link`] joins two peers by four lanes. The *latest* lane is a cell of size one. The *frames* lane
//! carries begin, batches of items, end. The *messages* lane carries messages, and the *bulk* lane blocks of
//! bytes that yield to all others. An application defines their types by a [`Protocol`]. [`connect`] and
//! [`Listener`] make links over the transport that an [`Endpoint`] names; using them is the same over each.
//!
//! ```
//! use std::sync::Arc;
//! use trimaran_transport::{FrameEvent, FrameStart, LinkConfig, Net, Protocol, TokioNet, inproc};
//!
//! /// Frames of numbers, and nothing else.
//! #[derive(Debug, Clone, PartialEq)]
//! struct Numbers;
//!
//! impl Protocol for Numbers {
//!     const NAME: &'static str = "numbers/1";
//!     type Hello = String;
//!     type Latest = ();
//!     type Header = ();
//!     type Item = u32;
//!     type Message = ();
//! }
//!
//! # #[tokio::main]
//! # async fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
//! let (hellos, config) = (("a".to_owned(), "b".to_owned()), LinkConfig::default());
//! let (mut a, mut b) = inproc::pair::<Numbers>(&net, hellos.0, hellos.1, &config)?;
//! a.frames_tx.send(FrameStart::new(0, ()), &[1, 2, 3]).await?;
//! let mut sum = 0;
//! loop {
//!     match b.frames_rx.recv().await? {
//!         FrameEvent::Batch(batch) => sum += batch.iter().sum::<u32>(),
//!         FrameEvent::End(_) => break,
//!         _ => {}
//!     }
//! }
//! assert_eq!(sum, 6);
//! # Ok(())
//! # }
//! ```
//!
//! All time, tasks and sockets come through one trait, [`Net`] of `trimaran-net`: [`TokioNet`] is the real
//! one. The README beside this crate shows more, from keys to deadlines.
//!
//! | module | contents |
//! |---|---|
//! | `link`, `lanes` | a link and its halves, over the application's types |
//! | `channels` | further lanes, by name and type |
//! | `publisher` | one sender of frames, many subscribers |
//! | `reconnecting` | a link that is made again whenever it is lost |
//! | `connect`, `listen`, `acceptor`, `handshake` | making links, and admission of peers |
//! | `application`, `peer` | the two sides of a link, for the layers that only handle bytes |
//! | [`untyped`] | links whose protocol is known only at run time |
//! | `endpoint`, `schemes` | the choice of a transport; only `schemes` and `options` name them all |
//! | `stream`, `tcp`, `unix`, [`ws`], [`quic`], [`udp`], [`inproc`] | the transports, each with its lanes |
//! | `transport`, `lane_transport`, `parts` | the tasks of a transport, and its result |
//! | [`keys`] | the keys of peers |
//! | `options`, `config`, `timeouts`, `rates`, `pending` | options; limits in time and number |
//! | `stats` | counters |
//! | `concurrent` | futures at the same time |
//! | `conformance` | the requirements on every transport, as a suite of tests |

#![cfg_attr(docsrs, feature(doc_cfg))] // the documentation says which feature has an item

mod acceptor;
mod application;
mod causes;
mod channels;
mod concurrent;
mod config;
#[cfg(feature = "conformance")]
pub mod conformance;
mod connect;
mod endpoint;
mod endpoints;
mod error;
mod handshake;
#[cfg(feature = "inproc")]
pub mod inproc;
#[cfg(feature = "keys")]
pub mod keys;
mod lane_transport;
mod lanes;
mod link;
mod listen;
mod options;
mod parts;
mod peer;
mod pending;
mod publisher;
#[cfg(feature = "quic")]
pub mod quic;
mod rates;
mod reconnecting;
mod schemes;
mod stats;
mod stream;
#[cfg(feature = "tcp")]
mod tcp;
#[cfg(test)]
mod tests;
mod timeouts;
mod transport;
#[cfg(feature = "udp")]
pub mod udp;
#[cfg(feature = "unix")]
mod unix;
pub mod untyped;
#[cfg(any(feature = "quic", feature = "udp"))]
mod watched_socket;
#[cfg(feature = "ws")]
pub mod ws;

pub use acceptor::{Acceptor, Place, Serving};
pub use causes::causes;
pub use channels::{ChannelError, Channels, FrameHalves, LatestHalves};
pub use config::limits::Limits;
pub use config::link::LinkConfig;
pub use connect::{ConnectError, connect, connect_once, growing_pauses};
pub use endpoint::{
    Endpoint, EndpointError, EndpointFault, Host, HostName, HostPort, Name, OtherEndpoint, SocketPath,
    UdpEndpoint, UdpMode, WsEndpoint, WsPath,
};
pub use endpoints::Endpoints;
pub use error::{LaneError, Loss, ProtocolError, RecvError, SendError};
pub use handshake::{HandshakeError, HelloTooLong};
pub use lane_transport::{Introduction, LaneTransport, Listened};
pub use lanes::blobs::{BlobError, BlobEvent, BlobReceiver, BlobSender};
pub use lanes::bulk::{BulkReceiver, BulkSender};
pub use lanes::frames::{FrameReceiver, FrameSender, KeepLast, SharedFrame, SharedFrames, WholeFrame};
pub use lanes::half::{Duplex, Half, LaneTx, Rx, Tx};
pub use lanes::latest::{LatestReceiver, LatestSender};
pub use lanes::messages::{MessageReceiver, MessageSender};
pub use lanes::{ByteChannel, Lanes};
pub use link::{Bulk, Link};
pub use listen::{AcceptError, ListenError, Listener};
pub use options::Options;
pub use parts::{ByteLanes, LinkParts};
pub use peer::{Peer, PeerAddress, PeerInfo, PeerName};
pub use pending::Slot;
pub use publisher::{Left, Published, Publisher, SubscriberId, SubscriberStats, WhenBehind};
pub use rates::{ListenerLimits, ListenerStats, TooMany, TurnedAway};
pub use reconnecting::{LinkError, LinkEvents, LinkState, Reconnecting};
pub use stats::{Counters, Direction, LinkStats, Skipped, StatsHandle, Tally, Traffic};
pub use transport::{AttemptError, Capabilities, ListenFault, Listening, Transport, Upgrade, first_address};
pub use trimaran_net::{
    Credentials, Instant, Net, TcpOptions, TokioNet, UdpSocketOptions, UnixSocketOptions, sleep_until, until,
};
#[cfg(feature = "udp")]
pub use trimaran_udp::PathStats;
pub use trimaran_wire::{
    Batch, BatchDecoder, BatchEncoder, BatchError, BatchSize, BatchSizeError, Batching, Channel,
    ChannelFormat, ChannelList, ChannelName, ChannelNumber, ChannelSizes, CloseReason, CodingError,
    CountCoded, DecodeError, DecodeFault, Delivery, Explanation, Fixed, FixedBytes, Format, FrameEnd,
    FrameEvent, FrameNumber, FrameOrderError, FrameOutcome, FrameStart, FrameViolation, FramesOf, Item, Kind,
    Lane, LatestOf, MAX_BLOCK, MAX_CHANNELS, MAX_MESSAGE, Protocol, ProtocolName, Refusal, Rejection,
    SessionId, WireVersion, WireVersions,
};
#[cfg(feature = "zerocopy")]
pub use trimaran_wire::{Plain, PlainError};
#[cfg(feature = "unix")]
pub use unix::{ForeignUser, UnixOptions};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
