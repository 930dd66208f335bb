//! Links over QUIC (RFC 9000): latest values as datagrams, a stream for each frame, TLS 1.3 with both sides'
//! certificates pinned.
//!
//! The connecting peer opens streams in both directions: one for control, one for messages, one for blocks,
//! and one for each channel. The control stream carries the hello and its answer, then copies of values that
//! no newer one followed, then the close of the latest lane. See `transport/wire/WIRE.md`.

mod carrier;
mod congestion;
pub(crate) mod connect;
pub(crate) mod control;
mod datagrams;
mod frames;
mod latest;
mod listen;
mod options;
mod records;
mod scheme;
pub(crate) mod tls;

pub use crate::keys::UnknownPeer;
pub use options::{Congestion, QuicOptions};
pub(crate) use scheme::Quic;
