//! The drivers: loops that move messages between links, state machines and what a role does with a frame.
//!
//! A driver is a future that knows of no runtime, device or clock. A real role is run by
//! [`block_on`](tokio::runtime::Handle::block_on) on a thread of its own, since its device blocks within the
//! future; a simulated one runs on the simulation's executor.

mod cameras;
mod close;
mod culler;
mod display;
mod error;

pub use cameras::Cameras;
pub use close::leave_unable;
pub(crate) use culler::OTHER;
pub use culler::{CullerRole, CullerWork, VisibleIds};
pub use display::{CullerTraffic, DisplayRole, DisplayWork, Drawn, Observer, ShownFrame};
pub use error::{BoxedError, LinkError, RoleError};
