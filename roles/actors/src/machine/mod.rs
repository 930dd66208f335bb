//! The roles as state machines: no sockets, no clock, no GPU.
//!
//! Frames alternate: the first culler culls the even frames, the second the odd ones. While one culls frame i
//! (HC), the other draws the occluders of frame i + 1 (OR) from the ids as they come; then they swap, and the
//! depth buffer never travels (the paper's SWITCH, section 3.2). The display shows each frame (RVG) and hands
//! out the cameras.
//!
//! ```text
//! frame          0      1      2      3
//! first   OR HC ─┐ OR ──► HC ─┐ OR ──►
//! second     OR ◄┘ HC ─┐ OR ◄─┘ HC
//! display            RVG    RVG    RVG
//! ```
//!
//! Cameras are handed out ahead: the camera of frame i + 2 goes to the culler that has just begun to cull
//! frame i, so its one-camera cell is free. That bounds how far cullers can run ahead of the display, with no
//! message of its own for it.

mod culler;
mod display;
mod order;

pub use culler::{CullerMachine, CullerStep};
pub use display::{DisplayMachine, DisplayStep};
pub use order::{CullerIndex, OrderError};
