//! Ports that must be known before something listens on them.

use std::net::{TcpListener, UdpSocket};
use std::process;
use std::sync::atomic::{AtomicU16, Ordering};

/// Below the ports that systems hand out, so that nobody gets one of these by chance.
const FIRST: u16 = 20_000;
const COUNT: u16 = 12_000;
/// How many ports a process has before those of the next process.
const EACH: u32 = 16;

static NEXT: AtomicU16 = AtomicU16::new(0);

/// A port on which nothing listens, over TCP or UDP, and that no other test gets.
pub(crate) fn unused_port() -> u16 {
    let begin = (process::id() * EACH % u32::from(COUNT)) as u16;
    loop {
        let port = FIRST + (begin + NEXT.fetch_add(1, Ordering::Relaxed)) % COUNT;
        let at = ("127.0.0.1", port);
        if TcpListener::bind(at).is_ok() && UdpSocket::bind(at).is_ok() {
            return port;
        }
    }
}
