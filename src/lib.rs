//! Trimaran walks through CAD models of process plants with tens of millions of triangles: cullers find the
//! visible nodes of a frame, and a display shows them.
//!
//! This crate joins the parts for the command line and for programs that want a whole walkthrough. The parts
//! can be used alone: [`trimaran_proto`] the wire, [`trimaran_transport`] the links, [`trimaran_scene`]
//! models, [`trimaran_cook`] cooking, [`trimaran_cull`] culling, [`trimaran_audit`] checks of it,
//! [`trimaran_gpu`] drawing, [`trimaran_actors`] the roles.
//!
//! A display and two cullers on a simulated network, in virtual time:
//!
//! ```
//! use std::time::Duration;
//! use trimaran::simulate::{Knobs, Load, Scenario, Transport, Workload, simulate};
//! use trimaran_actors::Schedule;
//! use trimaran_netsim::Profile;
//! use trimaran_proto::BatchSize;
//!
//! let ms = Duration::from_millis;
//! let outcome = simulate(&Scenario {
//!     network: Profile::find("wifi")?,
//!     link: Transport::Udp,
//!     cullers: 2,
//!     schedule: Schedule::Independent,
//!     batch: BatchSize::new(1024)?,
//!     frames: 20,
//!     seed: 1,
//!     workload: Workload::steady(Load { nodes: 1000, or: ms(5), hc: ms(5), rvg: ms(5) }),
//!     geometry: None,
//!     knobs: Knobs::default(),
//! })?;
//! assert!(outcome.latency_ms.p50 > 15.0, "OR, HC and RVG alone take that long");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | [`walkthrough`] | a walk of three roles on Vulkan, recorded and checked |
//! | [`report`] | its report: JSON, a page, text, pictures |
//! | [`session_hosts`] | the hosts of a session on a network of the simulator |
//! | [`simulate`], [`trace`] | roles in virtual time, and recorded walks for them |
//! | [`config`] | the configuration of roles and links |
//! | [`metrics`] | the traffic of links, for Prometheus |
//! | [`http`] | an HTTP server and client |
//! | [`notes`] | notes on a scene, in files and as BCF |
//! | [`page`] | a display in a browser, and the server from which it comes |
//! | [`scene_cache`] | cooked scenes of models that were viewed |
//! | `netem` | a simulated network between programs, on Linux |
//! | [`vulkan`] | the roles' devices |
//! | [`audit`] | whether culling is exact on small scenes, the hard cases among them |
//! | [`comparison`] | the systems to be compared with each other |
//! | `window` | a display in a window of the system, with the feature `window` |
//! | [`culling`] | how a culler culls: Trimaran's method, and those it is compared with |

#[cfg(feature = "lab")]
pub mod audit;
#[cfg(feature = "lab")]
pub mod comparison;
pub mod config;
pub mod culling;
pub mod http;
pub mod metrics;
#[cfg(all(feature = "lab", target_os = "linux"))]
pub mod netem;
pub mod notes;
pub mod page;
pub mod report;
pub mod scene_cache;
#[cfg(feature = "lab")]
pub mod session_hosts;
#[cfg(feature = "lab")]
pub mod simulate;
#[cfg(feature = "lab")]
pub mod trace;
pub mod vulkan;
pub mod walkthrough;
#[cfg(feature = "window")]
pub mod window;
