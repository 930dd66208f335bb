//! Roles that connect, walk and close, over links in this process.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[path = "../common/mod.rs"]
mod common;

mod choosing;
mod dealer;
mod faults;
mod following;
mod meetings;
mod packing;
mod relay;
mod rest;
mod sessions;
mod supply;
mod switch;
mod turns;
mod view_states;
