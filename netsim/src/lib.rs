//! Networks in virtual time.
//!
//! A [`Topology`] of hosts and [`link`]s becomes a [`Simulation`]. Programs on it run in no time, and the
//! same way each time. They are written for the trait `Net`, which each host's [`SimNet`] implements, or for
//! tokio, whose names [`tokio`] has.
//!
//! ```
//! use std::time::Duration;
//! use trimaran_net::{Net, sleep_until};
//! use trimaran_netsim::{Profile, Simulation};
//!
//! let mut network = Profile::find("wifi")?.sites();
//! let here = network.near("here");
//! let simulation = Simulation::new(&network.topology, 1);
//! let net = simulation.net(here);
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
//! | `host`, `topology`, `profile` | hosts and their links; whole networks in TOML |
//! | `simulation`, `executor`, `timers`, `events`, `world` | virtual time, and the programs in it |
//! | `control` | crashes, partitions and changes of links while programs run |
//! | [`link`] | one direction of a link, without a clock of its own |
//! | `fabric`, `packet`, `wire` | packets on their way through a topology |
//! | `net`, `tcp` | a host's sockets: datagrams, and a model of Linux's TCP |
//! | [`tokio`] | the names of tokio over a host's sockets and time |
//! | `relay` | the links of a topology for real packets |
//! | `capture` | packets for Wireshark |

#![cfg_attr(docsrs, feature(doc_cfg))] // the documentation says which feature has an item

mod capture;
mod control;
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
pub mod tokio;
mod topology;
mod wire;
mod world;

pub use capture::CaptureError;
pub use control::{Control, SetLinkError};
pub use host::HostId;
pub use net::{Scope, SimNet};
pub use profile::{Profile, ProfileError, ScheduleFault, Sites};
pub use relay::{Arrival, Relay, Totals};
pub use simulation::{Simulation, Stalled, UnknownHost};
pub use tcp::Class;
pub use topology::{NodeId, Topology};
pub use wire::WireTally;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
