//! Options of Unix sockets, and the credentials of their peers.

/// Options of a listening Unix socket.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct UnixSocketOptions {
    /// The permissions of the socket's file. Default `0o600`: only the same user may connect.
    pub mode: u32,
    /// How many connections may wait to be accepted. Default 128.
    pub backlog: i32,
}

impl UnixSocketOptions {
    crate::setters! {
        with_mode mode: u32,
        with_backlog backlog: i32,
    }
}

impl Default for UnixSocketOptions {
    fn default() -> Self {
        Self { mode: 0o600, backlog: 128 }
    }
}

/// The owner of the process at the other end of a Unix socket, as the kernel says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Credentials {
    /// The process's effective user id.
    pub uid: u32,
    /// Its effective group id.
    pub gid: u32,
    /// The process id, where the system tells.
    pub pid: Option<i32>,
}
