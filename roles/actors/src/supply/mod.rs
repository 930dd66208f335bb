//! Geometry for displays that hold no scene: visible geometry is sent to them on the bulk lane.
//!
//! A display asks one of its cullers. That one sends its own visible set's geometry at once, and on request
//! that of frames of other cullers. So nothing is sent twice, whichever culler finds it. Coarser drawables
//! may come first, as stand-ins for the rest; and while nothing is due, geometry that a moving camera will
//! soon need. The amount in flight is bounded so that cameras and ids never wait for it.

mod ahead;
mod culler_end;
mod display_end;
mod held;
mod holdings;
mod packed;
mod queue;
mod stand_ins;
mod supplier;
#[cfg(test)]
mod testing;
mod window;

pub(crate) use culler_end::CullerEnd;
pub(crate) use display_end::DisplayEnd;
pub(crate) use holdings::Holdings;
pub use holdings::{AheadUse, SupplyError};
pub(crate) use packed::Packed;
pub use packed::PackingCounts;
pub use supplier::SupplyFault;
