//! The drivers: loops that move messages between links, state machines and a role's work on a frame.
//!
//! A driver is a future independent of any runtime, device or clock. A real role is run by
//! [`block_on`](tokio::runtime::Handle::block_on) on a thread of its own, since its device blocks within the
//! future; a simulated one runs on the simulation's executor.

mod close;
mod culler;
mod culler_link;
mod display;
mod error;
mod in_turn;
mod introduction;
mod observer;
mod published;
mod session;
mod shown_stats;
mod views;
mod watcher;

pub(crate) use close::{leave_unable, reason};
pub use culler::{CullerRole, CullerWork, VisibleIds};
pub use display::{DisplayRole, DisplayWork, Supplied, WhileLoading};
pub use error::{BoxedError, LinkError, RoleError};
pub use observer::{CullerEvent, Observer, ShownFrame};
pub use published::Cameras;
pub(crate) use views::Views;
pub use watcher::WatcherRole;
