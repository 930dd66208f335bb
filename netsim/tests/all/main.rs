//! Networks in virtual time, compared with arithmetic and with kernels.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[macro_use]
#[path = "../virtual_time/mod.rs"]
mod virtual_time;

mod corpus;
mod floods;
mod packets;
mod quic;
mod tcp;
mod time;
mod udp;
