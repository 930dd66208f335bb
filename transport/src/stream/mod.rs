//! The lanes over byte streams: TCP, Unix sockets, and other ordered transports.

mod acceptor;
pub(crate) mod frames;
mod handshake;
mod inlet;
pub(crate) mod latest;
mod pulse;
pub(crate) mod records;
mod scheme;
mod source;
#[cfg(all(test, feature = "tcp"))]
mod tests;
mod writer;

pub(crate) use scheme::Streams;
