//! A display in a real browser, and in a window.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(clippy::disallowed_methods, reason = "what is tested keeps the system's time")]

#[path = "../common/mod.rs"]
mod common;

mod access;
mod controls;
mod hard_cases;
mod overview;
mod service;
mod tools;
mod walking;
mod whole_things;
#[cfg(feature = "window")]
mod window;
