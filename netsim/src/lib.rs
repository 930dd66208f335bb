//! Networks in virtual time, and the bandwidth formulas of the three-role system.
//!
//! A [`Topology`] of machines and [`link`]s becomes a [`Simulation`]; each machine's [`SimNet`] is the
//! transports' `Net`, so that programs written for that run here unchanged, in no time, and the same way each
//! time.

mod bandwidth;
mod capture;
mod events;
mod executor;
mod fabric;
pub mod link;
mod net;
mod packet;
mod profile;
mod random;
mod relay;
mod simulation;
mod tcp;
mod text;
mod timers;
mod topology;
mod wire;
mod world;

pub use bandwidth::{FrameLoad, bits_per_second};
pub use capture::CaptureError;
pub use net::SimNet;
pub use profile::{Machines, Profile, ProfileError, ScheduleFault};
pub use relay::{Arrival, Parting, Relay, Totals};
pub use simulation::{Simulation, Stalled};
pub use tcp::Class;
pub use topology::{HostId, NodeId, Topology};
pub use wire::WireTally;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
