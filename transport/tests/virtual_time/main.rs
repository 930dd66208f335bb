//! Links in virtual time, over each transport: the conformance suite, exact times, and reproducible runs.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[macro_use]
mod hosts;

mod corpus;
mod floods;
mod idle;
mod packets;
mod quic;
mod reconnecting;
mod sharing;
mod tcp;
mod udp;
