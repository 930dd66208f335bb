//! The simulator's links for real packets, in real time: `trimaran netem`.
//!
//! Machines are network namespaces with a TUN device each. What comes from there takes its way through a
//! [`Relay`](trimaran_netsim::Relay), the very link models of the simulator, and comes out at another machine
//! when they say so.

mod carrier;
mod emulation;
mod error;
mod ip;
mod iproute;
mod namespace;

pub use carrier::{Lateness, LinkReport, Report};
pub use emulation::Emulation;
pub use error::NetemError;
pub use namespace::Namespace;
