//! The three roles as state machines, their drivers, and the session that joins them.

mod machine;

pub use machine::{DisplayMachine, DisplayStep, OrderError, Seat, SwitchMachine, SwitchStep};
