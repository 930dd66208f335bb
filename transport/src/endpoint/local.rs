//! Peers on this machine: paths of sockets, and names within the process.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::atomic::{AtomicU64, Ordering};

use serde::{Deserialize, Serialize};

use super::{EndpointFault, is_plain};

/// The longest path of a Unix socket, bytes: the size of a `sockaddr_un` of Linux (108 with the closing
/// zero). Systems with less room fail when the socket is made.
pub(super) const LONGEST_PATH: usize = 107;

/// The longest name of a listener within a process, bytes.
pub(super) const LONGEST_NAME: usize = 64;

/// The absolute path of a Unix socket, 2 to 107 bytes.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct SocketPath(String);

/// The name of a listener within a process, or of a peer: 1 to 64 letters, digits, dots, hyphens and
/// underscores.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Name(String);

impl SocketPath {
    /// The path.
    #[must_use]
    pub fn as_path(&self) -> &Path {
        Path::new(&self.0)
    }

    /// The endpoint's path for `path`.
    ///
    /// # Errors
    /// If it is not absolute, not UTF-8, or too long for a socket.
    pub fn new(path: impl Into<PathBuf>) -> Result<Self, EndpointFault> {
        path.into().to_str().ok_or(EndpointFault::Path)?.parse()
    }
}

impl FromStr for SocketPath {
    type Err = EndpointFault;

    fn from_str(text: &str) -> Result<Self, EndpointFault> {
        let fits = (2..=LONGEST_PATH).contains(&text.len());
        if !fits || !text.starts_with('/') || text.ends_with('/') || text.contains('\0') {
            return Err(EndpointFault::Path);
        }
        Ok(Self(text.to_owned()))
    }
}

impl fmt::Display for SocketPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Name {
    /// A name that is unique in the process.
    #[must_use]
    pub fn unique() -> Self {
        static GIVEN: AtomicU64 = AtomicU64::new(0);
        Self(format!("unique-{}", GIVEN.fetch_add(1, Ordering::Relaxed)))
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for Name {
    type Err = EndpointFault;

    fn from_str(text: &str) -> Result<Self, EndpointFault> {
        if text.is_empty() || text.len() > LONGEST_NAME || !is_plain(text) {
            return Err(EndpointFault::Name);
        }
        Ok(Self(text.to_owned()))
    }
}

impl TryFrom<String> for Name {
    type Error = EndpointFault;

    fn try_from(text: String) -> Result<Self, EndpointFault> {
        text.parse()
    }
}

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}
