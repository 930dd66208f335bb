//! Frames and messages over datagrams: the state machine of a connection, without sockets or a clock.
//!
//! A [`Connection`] carries the lanes of a link in packets that fit the path: the newest value, sent again
//! until it or a newer one has arrived, and three lanes of units: frames, messages, blocks. Each unit is
//! assembled independently, so a lost packet holds up no other unit on the wire; units are delivered in
//! order.
//!
//! ```
//! use trimaran_net::Instant;
//! use trimaran_udp::{Config, Connection, ConnectionId};
//! use trimaran_wire::{FixedBytes, Format};
//!
//! // Two ends that know each other already, in the clear; else `Acceptor` and `Connecting` make them.
//! let (here, there) = (ConnectionId(1), ConnectionId(2));
//! let config = || Config::new(Format { latest: 4, ..Format::default() });
//! let mut now = Instant::from_nanos(0);
//! let mut near = Connection::plaintext(now, here, there, config());
//! let mut far = Connection::plaintext(now, there, here, config());
//!
//! let value: FixedBytes = [1_u8, 2, 3, 4].into_iter().collect();
//! near.publish(None, value.clone());
//! let mut datagram = Vec::new();
//! while near.poll_transmit(now, &mut datagram) {
//!     now = now.after(std::time::Duration::from_millis(5)); // so long is the path
//!     far.handle(now, &datagram);
//!     datagram.clear();
//! }
//! assert_eq!(far.latest(None), Some(value));
//! ```
//!
//! | module | contents |
//! |---|---|
//! | `handshake`, `cookie`, `keys` | the handshake of a connection, and its keys |
//! | `connection` | [`Connection`]: packets received, packets to send, timers |
//! | `latest`, `outbox`, `inbox` | the lanes: the newest value; sending and receiving units |
//! | `packet`, `chunk`, `wire`, `ranges` | packets and their contents |
//! | `recovery`, `acks`, `rtt`, `congestion`, `pacer`, `scavenger` | loss detection and congestion control |
//! | `repair` | forward error correction of frames |
//! | `mtu`, `peer_path` | path MTU discovery; path migration of the peer |

#![cfg_attr(docsrs, feature(doc_cfg))] // the documentation says which feature has an item

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
mod reset;
mod rtt;
#[cfg(test)]
mod samples;
mod scavenger;
mod spare;
mod wire;

pub use chunk::UnitLane;
pub use connection::{
    Closed, Config, Connection, DeadlineTooShort, PathStats, STEPS_PER_BYTE, STEPS_PER_PACKET,
};
pub use handshake::{Acceptor, Connecting, Handled, HandshakeError, Initial, MAX_HELLO, Progress, Security};
pub use inbox::{LaneViolation, Received};
pub use latest::LatestEnd;
pub use packet::{ConnectionId, MIN_DATAGRAM, VERSION, destination};
pub use repair::Repair;
pub use wire::Malformed;
