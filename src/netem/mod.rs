//! The simulator's links for real packets, in real time: `trimaran netem`.
//!
//! Machines are network namespaces with a TUN device each. Their packets pass through a
//! [`Relay`](trimaran_netsim::Relay), with the same link models as the simulator, and come out at another
//! machine at the modelled time.

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
