//! Links over QUIC (RFC 9000): values of the latest lane as datagrams, a stream for each frame, TLS 1.3 with
//! both sides' certificates pinned.
//!
//! The peer that connects opens one stream in both directions, the control stream: hello and its answer, then
//! copies of values that no newer one has followed, then the goodbye of the latest lane. See
//! `proto/WIRE.md`.

mod carrier;
mod connect;
mod control;
mod frames;
mod latest;
#[cfg(test)]
mod lies;
mod listen;
mod options;
mod runtime;
mod tls;

pub(crate) use connect::attempt;
pub(crate) use frames::{FrameRx, FrameTx};
pub(crate) use latest::{LatestRx, LatestTx};
pub(crate) use listen::listen;
pub use options::{Congestion, CongestionError, QuicOptions};
pub use tls::UnknownPeer;

use crate::link::Capabilities;

pub(crate) const CAPABILITIES: Capabilities =
    Capabilities { reliable: true, ordered: true, encrypted: true, local: false };
