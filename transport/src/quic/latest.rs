//! The latest lane over QUIC: each value is a datagram, sent once. The newest is copied to the control
//! stream, which delivers for certain, when no newer one has followed for a while: so a value may be lost,
//! but never the last one.

mod receive;
mod send;

pub(crate) use receive::LatestRx;
pub(crate) use send::LatestTx;
