//! The program as its users meet it: processes, files, exit codes.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(clippy::disallowed_methods, reason = "what is tested keeps the system's time")]

#[path = "../common/mod.rs"]
mod common;

mod audit;
mod clash;
mod cli;
#[cfg(target_os = "linux")]
mod clock;
mod compare;
mod configs;
mod coordinates;
mod corpus;
mod deployment;
mod doctor;
mod empty_display;
mod empty_display_real;
mod imports;
mod keys;
#[cfg(target_os = "linux")]
mod limited_memory;
mod many_walks;
mod metrics;
#[cfg(target_os = "linux")]
mod mpi;
mod notes;
#[cfg(target_os = "linux")]
mod partition;
mod ping;
mod rejoin;
mod relay;
mod reload;
#[cfg(target_os = "linux")]
mod requests;
mod resume;
mod second_driver;
mod services;
mod simulate_cli;
#[cfg(target_os = "linux")]
mod slurm;
mod sources;
mod two_versions;
mod view;
mod waiting;
