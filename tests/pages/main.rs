//! A display in a real browser, and in a window.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]
#![allow(clippy::disallowed_methods, reason = "what is tested keeps the system's time")]

#[path = "../common/mod.rs"]
mod common;

mod access;
mod all_of_a_kind;
mod clearance;
mod controls;
mod embedding;
mod hard_cases;
mod looks;
mod notes;
mod overview;
mod parallel;
mod service;
mod together;
mod tools;
mod walking;
mod where_am_i;
mod whole_things;
#[cfg(feature = "window")]
mod window;
