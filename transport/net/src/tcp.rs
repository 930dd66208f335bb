//! Options of TCP connections.

use std::time::Duration;

/// Options of each TCP connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct TcpOptions {
    /// Sends at once, without Nagle's wait for an acknowledgement. Default true.
    pub nodelay: bool,
    /// The system's send buffer, bytes; `None` leaves it to the system, which adapts it.
    pub send_buffer: Option<usize>,
    /// The system's receive buffer, bytes; `None` leaves it to the system, which adapts it.
    pub recv_buffer: Option<usize>,
    /// How long a connection is idle before the system probes the peer's system. Default 5 s. `None` (in a
    /// file 0) never probes.
    #[cfg_attr(
        feature = "config",
        serde(rename = "keepalive_s", with = "crate::config::seconds_or_off"),
        schemars(with = "f64")
    )]
    pub keepalive: Option<Duration>,
    /// The time between two such probes. Default 2 s.
    #[cfg_attr(
        feature = "config",
        serde(rename = "keepalive_interval_s", with = "crate::config::seconds"),
        schemars(with = "f64")
    )]
    pub keepalive_interval: Duration,
    /// How long data may wait for the peer's system, or for room on its side, before the connection counts
    /// as dead (`TCP_USER_TIMEOUT`; Linux only). Default 20 s. `None` (in a file 0) leaves it to the
    /// system: about 15 minutes.
    #[cfg_attr(
        feature = "config",
        serde(rename = "user_timeout_s", with = "crate::config::seconds_or_off"),
        schemars(with = "f64")
    )]
    pub user_timeout: Option<Duration>,
    /// How many connections may wait to be accepted. Default 128.
    pub backlog: i32,
}

impl TcpOptions {
    crate::setters! {
        with_nodelay nodelay: bool,
        with_send_buffer send_buffer: Option<usize>,
        with_recv_buffer recv_buffer: Option<usize>,
        with_keepalive keepalive: Option<Duration>,
        with_keepalive_interval keepalive_interval: Duration,
        with_user_timeout user_timeout: Option<Duration>,
        with_backlog backlog: i32,
    }
}

impl Default for TcpOptions {
    fn default() -> Self {
        Self {
            nodelay: true,
            send_buffer: None,
            recv_buffer: None,
            keepalive: Some(Duration::from_secs(5)),
            keepalive_interval: Duration::from_secs(2),
            user_timeout: Some(Duration::from_secs(20)),
            backlog: 128,
        }
    }
}
