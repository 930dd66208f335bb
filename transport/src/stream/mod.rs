//! The lanes over byte streams: TCP, Unix sockets, and other ordered transports.

mod acceptor;
mod frames;
pub(crate) mod handshake;
mod inlet;
mod latest;
mod pulse;
mod records;
mod scheme;
mod source;
mod writer;

pub(crate) use scheme::Streams;
