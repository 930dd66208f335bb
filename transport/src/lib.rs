//! Links for frame-synchronous data over pluggable transports.
//!
//! A [`Link`] joins two peers by two lanes: the *latest* lane is a cell of size one for the newest camera, the *frames* lane
//! carries begin, ids, end. [`inproc::pair`] makes two joined links in one process, [`tcp::connect`] and [`tcp::Listener`]
//! make them over TCP; using them is the same.
//!
//! All time, tasks and sockets come through one trait, [`Net`]: [`TokioNet`] is the real one.

mod error;
mod frames;
pub mod inproc;
mod latest;
mod link;
mod net;
mod patience;
mod stats;
mod stream;
pub mod tcp;
mod tokio_net;

pub use error::{Loss, ProtocolError, RecvError, SendError};
pub use frames::{FrameReceiver, FrameSender};
pub use latest::{LatestReceiver, LatestSender};
pub use link::{Link, LinkConfig, PeerAddress, PeerInfo};
pub use net::{BoxFuture, BoxReader, BoxWriter, Instant, Listen, Net, Stream, Timer, sleep_until, until};
pub use stats::{LinkStats, StatsHandle, Tally, Traffic};
pub use tcp::TcpOptions;
pub use tokio_net::TokioNet;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
