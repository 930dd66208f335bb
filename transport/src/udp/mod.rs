//! Links over datagrams of this crate's own protocol. Frames are assembled independently, so a loss holds up
//! one frame and not the connection.
//!
//! The protocol is the state machine of `trimaran-udp`; here are its sockets, tasks and timers, all from the
//! [`Net`](crate::Net). One task per socket receives, one task per connection keeps its timers, and senders
//! send at once.

mod connect;
mod driver;
mod frames;
mod latest;
mod listen;
mod options;
mod parts;
mod port;
mod records;
mod scheme;
mod socket;
mod units;

pub use options::{Trust, UdpOptions};
pub(crate) use scheme::Udp;
pub use trimaran_udp::{Closed, LaneViolation, MIN_DATAGRAM, Repair};
