//! The simulator's links for real packets, in real time: `trimaran netem`.
//!
//! Machines are network namespaces with a TUN device each, or whatever is behind two Ethernet interfaces;
//! what comes from there takes its way through a [`Relay`](trimaran_netsim::Relay), the very link models of
//! the simulator, and comes out at another machine when they say so.

#[cfg(target_os = "linux")]
mod carrier;
#[cfg(target_os = "linux")]
mod emulation;
#[cfg(target_os = "linux")]
mod error;
#[cfg(target_os = "linux")]
mod interface;
#[cfg(target_os = "linux")]
mod ip;
#[cfg(target_os = "linux")]
mod iproute;
#[cfg(target_os = "linux")]
mod namespace;
mod tc;

#[cfg(target_os = "linux")]
pub use carrier::{Lateness, LinkReport, Report};
#[cfg(target_os = "linux")]
pub use emulation::Emulation;
#[cfg(target_os = "linux")]
pub use error::NetemError;
#[cfg(target_os = "linux")]
pub use interface::Interface;
#[cfg(target_os = "linux")]
pub use namespace::Namespace;
pub use tc::tc_commands;
