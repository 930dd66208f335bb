//! Whole sessions in this process: real devices, simulated and emulated networks, real models.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(clippy::disallowed_methods, reason = "what is tested keeps the system's time")]

#[path = "../common/mod.rs"]
mod common;

#[cfg(target_os = "linux")]
mod addresses;
mod causes;
mod dissector;
mod hard_cases;
mod model;
#[cfg(target_os = "linux")]
mod netem;
mod real_models;
mod search;
mod simulate;
mod truth;
mod view_state;
mod walkthrough;
