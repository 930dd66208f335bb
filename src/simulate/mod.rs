//! A session of the three roles on a simulated network. The roles, links and transports are the real ones.
//! Their computing times come from a recorded walk or a stated model, and the network is a
//! [`Profile`](trimaran_netsim::Profile).
//!
//! Ten thousand frames take seconds, and the same seed gives the same frames.

mod bytes;
mod error;
mod outcome;
mod page;
mod pixels;
mod recorded;
mod roles;
mod scenario;
mod session;
mod statistics;
mod tables;
mod workload;

pub use bytes::FrameBytes;
pub use error::SimulateError;
pub use outcome::{FrameTimes, Outcome, Session, Split, pooled};
pub use page::page;
pub use pixels::{Painter, PixelError};
pub use roles::Roles;
pub use scenario::{Geometry, Knobs, Scenario, Transport};
pub use session::{simulate, simulate_watched};
pub use statistics::{Percentiles, PixelCost, Spread};
pub use tables::{frames_csv, runs_csv, tables};
pub use workload::{Load, Times, Workload, WorkloadError};
