//! The bandwidth formulas of the three-role system, and the network simulator's home.

mod bandwidth;

pub use bandwidth::{FrameLoad, bits_per_second};
