//! The guarantees of links, over each transport and between them.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[path = "../common/mod.rs"]
#[macro_use]
mod common;
#[allow(dead_code, reason = "other crates' tests use the rest")]
#[path = "../../wire/tests/all/examples/mod.rs"]
mod examples;

#[cfg(all(feature = "quic", feature = "tcp", feature = "udp", feature = "unix", feature = "inproc"))]
mod api;
#[cfg(all(unix, feature = "inproc", feature = "tcp"))]
mod application;
#[cfg(all(unix, feature = "tcp", feature = "unix"))]
mod hostile;
#[cfg(all(feature = "inproc", feature = "keys"))]
mod idle_timeout;
#[cfg(feature = "inproc")]
mod inproc;
#[cfg(all(feature = "quic", feature = "tcp", feature = "udp"))]
mod limits;
#[cfg(all(feature = "inproc", feature = "tcp"))]
mod log;
#[cfg(all(unix, feature = "quic", feature = "tcp", feature = "udp", feature = "unix"))]
mod observers;
#[cfg(feature = "quic")]
mod quic;
#[cfg(all(unix, feature = "quic", feature = "tcp", feature = "udp", feature = "unix", feature = "ws"))]
mod reconnecting;
#[cfg(all(feature = "quic", feature = "udp"))]
mod roles;
#[cfg(all(unix, feature = "quic", feature = "udp"))]
mod strangers;
#[cfg(all(feature = "inproc", feature = "tcp"))]
mod tasks;
#[cfg(feature = "tcp")]
mod tcp;
#[cfg(feature = "tcp")]
mod tcp_faults;
#[cfg(feature = "ws")]
mod typescript;
#[cfg(feature = "udp")]
mod udp;
#[cfg(all(target_os = "linux", feature = "udp"))]
mod udp_addresses;
#[cfg(feature = "udp")]
mod udp_way;
#[cfg(all(unix, feature = "unix"))]
mod unix;
#[cfg(all(unix, feature = "quic", feature = "tcp", feature = "udp", feature = "unix", feature = "inproc"))]
mod untyped;
#[cfg(all(unix, feature = "quic", feature = "tcp", feature = "udp", feature = "unix", feature = "ws"))]
mod versions;
#[cfg(all(feature = "quic", feature = "udp"))]
mod way;
#[cfg(feature = "ws")]
mod ws;
#[cfg(feature = "ws")]
mod wss;
