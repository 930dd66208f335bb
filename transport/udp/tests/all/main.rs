//! The datagram protocol between two ends in one thread: pairs, handshakes, and the cost of attacks.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[allow(unreachable_pub, dead_code, reason = "a benchmark uses it too")]
#[path = "../adversary/mod.rs"]
mod adversary;
#[allow(unreachable_pub, dead_code, reason = "the fuzz targets use it too")]
#[path = "../../../../fuzz/src/wire.rs"]
mod wire;

mod corpus;
mod costs;
mod handshake;
mod pair;
