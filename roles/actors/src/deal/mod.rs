//! Assigns frames to cullers, and decides the next frame to show: no link, no clock of its own, no GPU.
//!
//! The display deals cameras to cullers, which do not wait for each other:
//!
//! ```text
//! frame        0      1      2      3
//! culler 1   OR HC         OR HC          independent: OR draws what this culler found visible last
//! culler 2          OR HC         OR HC
//! display         RVG    RVG    RVG
//! ```
//!
//! A culler has at most two cameras: that of the frame which it culls, and the next one in its one-camera
//! cell. The display deals the next one when a frame begins to come. That bounds how far cullers run ahead,
//! with no message of its own for it.

mod culler_id;
mod dealer;
mod schedule;
mod usual;

pub use culler_id::CullerId;
pub use dealer::{Dealer, Disorder, Pace};
pub use schedule::{Schedule, UnknownSchedule};
