//! Networks in virtual time.
//!
//! A [`Topology`] of machines and [`link`]s becomes a [`Simulation`]. Each machine's [`SimNet`] is the
//! transports' `Net`, so programs written for `Net` run here unchanged, in no time, and the same way each
//! time.
//!
//! ```
//! use std::time::Duration;
//! use trimaran_net::{Net, sleep_until};
//! use trimaran_netsim::{Profile, Simulation};
//!
//! let (topology, machines) = Profile::find("wifi")?.topology(2);
//! let simulation = Simulation::new(&topology, 1);
//! let net = simulation.net(machines.display);
//! simulation.run(async {
//!     let hour = net.now().after(Duration::from_secs(3600));
//!     sleep_until(&net, hour).await; // an hour that takes no time
//! })?;
//! assert_eq!(simulation.now().as_nanos(), 3_600_000_000_000);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | contents |
//! |---|---|
//! | `host`, `topology`, `profile` | machines and their links; whole networks in TOML |
//! | `simulation`, `executor`, `timers`, `events`, `world` | virtual time, and the programs in it |
//! | [`link`] | one direction of a link, without a clock of its own |
//! | `fabric`, `packet`, `wire` | packets on their way through a topology |
//! | `net`, `tcp` | a machine's sockets: datagrams, and a model of Linux's TCP |
//! | `relay` | the links of a topology for real packets |
//! | `capture` | packets for Wireshark |

mod capture;
mod events;
mod executor;
mod fabric;
mod host;
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

pub use capture::CaptureError;
pub use host::HostId;
pub use net::SimNet;
pub use profile::{Machines, Profile, ProfileError, ScheduleFault};
pub use relay::{Arrival, Relay, Totals};
pub use simulation::{Simulation, Stalled};
pub use tcp::Class;
pub use topology::{NodeId, Topology};
pub use wire::WireTally;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
