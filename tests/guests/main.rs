//! Attacks of clients on each other and on a service.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(clippy::disallowed_methods, reason = "what is tested keeps the system's time")]

#[path = "../common/mod.rs"]
mod common;

mod displays;
mod links;
