//! How TCP connections are set up.

use std::time::Duration;

/// Options of each TCP connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TcpOptions {
    /// Send at once, without Nagle's wait for an acknowledgement. Default true.
    pub nodelay: bool,
    /// The system's send buffer, bytes; `None` leaves it to the system, which adapts it.
    pub send_buffer: Option<usize>,
    /// The system's receive buffer, bytes; `None` leaves it to the system, which adapts it.
    pub recv_buffer: Option<usize>,
    /// Probes of an idle connection, answered by the peer's system even while the peer is busy. Default
    /// after 5 s.
    pub keepalive: Option<Keepalive>,
    /// How long data may wait for the peer's system, or for room on its side, before the connection counts
    /// as dead (`TCP_USER_TIMEOUT`; Linux only). Default 20 s. `None` leaves it to the system: about 15
    /// minutes.
    pub user_timeout: Option<Duration>,
    /// How many connections may wait to be accepted.
    pub backlog: i32,
}

/// Probes of an idle connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Keepalive {
    /// How long a connection is idle before the first probe.
    pub idle: Duration,
    /// The time between two probes.
    pub interval: Duration,
}

impl Default for TcpOptions {
    fn default() -> Self {
        Self {
            nodelay: true,
            send_buffer: None,
            recv_buffer: None,
            keepalive: Some(Keepalive { idle: Duration::from_secs(5), interval: Duration::from_secs(2) }),
            user_timeout: Some(Duration::from_secs(20)),
            backlog: 128,
        }
    }
}
