//! What connections over streams of the system can be told: TCP and Unix sockets.

use std::{fmt, str::FromStr};

use confique::Config;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_transport::{Keepalive, TcpOptions, UnixOptions};

use super::{super::seconds, duration, pause};

/// How TCP connections are set up.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct TcpConfig {
    /// Whether data leave at once, without Nagle's wait for an acknowledgement.
    #[config(
        env = "TRIMARAN_LINK_TCP_NODELAY",
        default = true,
        layer_attr(arg(
            long = "tcp-nodelay",
            num_args = 0..=1,
            default_missing_value = "true",
            value_name = "BOOL"
        ))
    )]
    pub nodelay: bool,
    /// The send buffer that the system is asked for, bytes; it chooses and adapts one if not given.
    #[config(
        env = "TRIMARAN_LINK_TCP_SEND_BUFFER",
        layer_attr(arg(long = "tcp-send-buffer", id = "tcp_send_buffer", value_name = "BYTES"))
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub send_buffer: Option<usize>,
    /// The receive buffer that the system is asked for, bytes; it chooses and adapts one if not given.
    #[config(
        env = "TRIMARAN_LINK_TCP_RECV_BUFFER",
        layer_attr(arg(long = "tcp-recv-buffer", id = "tcp_recv_buffer", value_name = "BYTES"))
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recv_buffer: Option<usize>,
    /// How long a connection is idle before the system asks the peer's system whether it is there, seconds;
    /// 0 never asks.
    #[config(
        env = "TRIMARAN_LINK_TCP_KEEPALIVE_S",
        default = 5.0,
        validate = seconds,
        layer_attr(arg(
            long = "tcp-keepalive",
            value_name = "S",
            value_parser = pause,
            allow_negative_numbers = true
        ))
    )]
    pub keepalive_s: f64,
    /// The time between two such questions, seconds.
    #[config(
        env = "TRIMARAN_LINK_TCP_KEEPALIVE_INTERVAL_S",
        default = 2.0,
        validate = seconds,
        layer_attr(arg(
            long = "tcp-keepalive-interval",
            value_name = "S",
            value_parser = pause,
            allow_negative_numbers = true
        ))
    )]
    pub keepalive_interval_s: f64,
    /// How long data may wait for the peer's system, or for room there, before the connection counts as
    /// dead, seconds (Linux); 0 leaves it to the system: a quarter of an hour, about.
    #[config(
        env = "TRIMARAN_LINK_TCP_USER_TIMEOUT_S",
        default = 20.0,
        validate = seconds,
        layer_attr(arg(
            long = "tcp-user-timeout",
            value_name = "S",
            value_parser = pause,
            allow_negative_numbers = true
        ))
    )]
    pub user_timeout_s: f64,
}

/// How Unix sockets are set up.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct UnixConfig {
    /// The permissions of the socket's file, as `chmod` takes them.
    #[config(
        env = "TRIMARAN_LINK_UNIX_MODE",
        default = "600",
        layer_attr(arg(long = "unix-mode", id = "unix_mode", value_name = "MODE"))
    )]
    pub mode: FileMode,
    /// Whose processes are taken as peers beside those of the own user: a list of user ids.
    #[config(
        env = "TRIMARAN_LINK_UNIX_ALLOW_UIDS",
        default = [],
        parse_env = confique::env::parse::list_by_comma,
        layer_attr(arg(long = "unix-allow-uids", value_name = "UID,..", value_delimiter = ','))
    )]
    pub allow_uids: Vec<u32>,
}

/// The permissions of a file, as text three octal digits, or four with a zero in front.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct FileMode(u32);

/// A text that is no file mode.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0:?} is no file mode: give three octal digits in quotes, such as \"600\" or \"660\"")]
pub struct FileModeError(String);

impl FromStr for FileMode {
    type Err = FileModeError;

    fn from_str(text: &str) -> Result<Self, FileModeError> {
        let digits = text.strip_prefix('0').filter(|rest| rest.len() == 3).unwrap_or(text);
        let octal = digits.len() == 3 && digits.bytes().all(|digit| (b'0'..=b'7').contains(&digit));
        let mode = u32::from_str_radix(digits, 8).ok().filter(|_| octal);
        mode.map(Self).ok_or_else(|| FileModeError(text.to_owned()))
    }
}

impl fmt::Display for FileMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:03o}", self.0)
    }
}

impl TryFrom<String> for FileMode {
    type Error = FileModeError;

    fn try_from(text: String) -> Result<Self, FileModeError> {
        text.parse()
    }
}

impl From<FileMode> for String {
    fn from(mode: FileMode) -> Self {
        mode.to_string()
    }
}

impl TcpConfig {
    pub(super) fn options(&self) -> TcpOptions {
        let unless_zero = |seconds: f64| (seconds > 0.0).then(|| duration(seconds));
        TcpOptions {
            nodelay: self.nodelay,
            send_buffer: self.send_buffer,
            recv_buffer: self.recv_buffer,
            keepalive: unless_zero(self.keepalive_s)
                .map(|idle| Keepalive { idle, interval: duration(self.keepalive_interval_s) }),
            user_timeout: unless_zero(self.user_timeout_s),
            ..TcpOptions::default()
        }
    }
}

impl UnixConfig {
    pub(super) fn options(&self) -> UnixOptions {
        UnixOptions { mode: self.mode.0, allow_uids: self.allow_uids.clone(), ..UnixOptions::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_mode_is_three_octal_digits() {
        for (text, mode) in [("600", 0o600), ("0660", 0o660), ("007", 0o007)] {
            assert_eq!(text.parse(), Ok(FileMode(mode)), "{text}");
        }
        for text in ["", "60", "0600 ", "1600", "800", "0o600", "+60", "00600"] {
            let error = text.parse::<FileMode>().unwrap_err().to_string();
            assert!(error.contains("three octal digits"), "{error}");
        }
    }
}
