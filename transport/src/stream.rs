//! The lanes over byte streams: TCP, Unix sockets, and whatever else carries bytes in order.

mod acceptor;
mod frames;
mod handshake;
mod inlet;
mod introduce;
mod latest;
mod messages;
mod pulse;
mod scheme;
mod source;
mod writer;

use acceptor::serve;
pub(crate) use frames::{FrameRx, FrameTx};
use introduce::introduce;
pub(crate) use latest::{LatestRx, LatestTx};
pub(crate) use messages::{MessageRx, MessageTx};
pub(crate) use scheme::Streams;
pub(crate) use source::{Sink, Source};
