//! Geometry for displays that hold no scene: what becomes visible travels to them on the bulk lane.
//!
//! A display asks one of its cullers. That one sends what it finds visible itself at once, and what the
//! display lacks of frames of other cullers when the display says so. So nothing is sent twice, whichever
//! culler finds it. Coarser drawables may come first, to stand in for the rest; and while nothing is due,
//! what a moving camera is about to need. How much is under way at once is bounded so that cameras and ids
//! wait for none of it.

mod ahead;
mod culler_end;
mod display_end;
mod held;
mod holdings;
mod queue;
mod stand_ins;
mod supplier;
mod window;

pub(crate) use culler_end::CullerEnd;
pub(crate) use display_end::DisplayEnd;
pub(crate) use holdings::Holdings;
pub use holdings::{AheadUse, SupplyError};
pub use supplier::SupplyFault;
