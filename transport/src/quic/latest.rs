//! The latest lane over QUIC: each value is a datagram, sent once. After a short quiet time the newest is
//! copied to the control stream, which delivers reliably. So a value may be lost, but never the last one.

mod receive;
mod send;

pub(crate) use receive::LatestRx;
pub(crate) use send::LatestTx;
