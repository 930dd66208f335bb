//! How Unix sockets are set up.

use trimaran_net::UnixSocketOptions;

/// Options of Unix sockets.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
pub struct UnixOptions {
    /// The permissions of the socket's file. Default `0o600`: only the own user may connect.
    #[cfg_attr(feature = "config", serde(with = "crate::config::file_mode"), schemars(with = "String"))]
    pub mode: u32,
    /// Whose processes are taken as peers beside those of the own user, by user id. Default nobody.
    pub allow_uids: Vec<u32>,
    /// How many connections may wait to be accepted. Default 128.
    pub backlog: i32,
}

impl Default for UnixOptions {
    fn default() -> Self {
        let UnixSocketOptions { mode, backlog } = UnixSocketOptions::default();
        Self { mode, allow_uids: Vec::new(), backlog }
    }
}

impl UnixOptions {
    pub(super) const fn socket(&self) -> UnixSocketOptions {
        UnixSocketOptions { mode: self.mode, backlog: self.backlog }
    }
}
