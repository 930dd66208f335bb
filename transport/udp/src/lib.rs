//! Frames and messages over datagrams: the state machine of a connection, without sockets or a clock.
//!
//! A [`Connection`] carries the lanes of a link in packets that fit the path: the newest value, sent
//! again until it or a newer one has arrived, and two lanes of units: frames, and messages. Each unit is put
//! together by itself, so that the loss of a packet holds up no other one on the wire; they are passed on in
//! order.

mod acks;
mod chunk;
mod congestion;
mod connection;
mod cookie;
#[cfg(test)]
mod examples;
mod handshake;
mod inbox;
mod keys;
mod latest;
#[cfg(test)]
mod lies;
mod mtu;
mod outbox;
mod pacer;
mod packet;
mod peer_path;
mod ranges;
mod recovery;
mod repair;
mod rtt;
mod spare;
mod wire;

pub use chunk::UnitLane;
pub use congestion::Congestion;
pub use connection::{
    Closed, Config, Connection, DeadlineTooShort, PathStats, STEPS_PER_BYTE, STEPS_PER_PACKET,
};
pub use handshake::{Acceptor, Connecting, Handled, HandshakeError, Initial, MAX_HELLO, Progress, Security};
pub use inbox::{LaneViolation, Received};
pub use latest::LatestEnd;
pub use packet::{ConnectionId, MIN_DATAGRAM, VERSION, destination};
pub use repair::Repair;
pub use wire::Malformed;
