//! A display in a window of the system.

pub mod navigate;
