//! Why a network cannot be emulated.

use std::io;

use thiserror::Error;

/// Why a network cannot be emulated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NetemError {
    /// This process lacks a privilege.
    #[error(
        "emulating a network makes network namespaces and TUN devices, which takes the capabilities CAP_NET_ADMIN and CAP_SYS_ADMIN, and {missing} is missing: run it as root"
    )]
    NotPermitted {
        /// The missing privilege.
        missing: &'static str,
    },
    /// The kernel has no TUN devices.
    #[error("there is no /dev/net/tun: load the kernel's module `tun`, or let the container have the device")]
    NoTun,
    /// There can be more or fewer machines than that.
    #[error("{count} namespaces: name those of 1 to 8 cullers, and last the display's, each once")]
    Namespaces {
        /// How many were given.
        count: usize,
    },
    /// iproute2 is not installed.
    #[error("the program `ip` does not run: install the package iproute2")]
    NoIp {
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// iproute2 failed.
    #[error("`ip {command}` failed: {said}")]
    Ip {
        /// The command.
        command: String,
        /// Its error message.
        said: String,
    },
    /// The namespace cannot be opened.
    #[error("cannot open the network namespace {namespace}")]
    Namespace {
        /// Its name.
        namespace: String,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// A device could not be made.
    #[error("cannot make a TUN device in the namespace {namespace}")]
    Device {
        /// Its namespace.
        namespace: String,
        /// The system's error.
        #[source]
        cause: io::Error,
    },
    /// Lateness cannot be counted.
    #[error("no memory to count how late packets are")]
    Count(#[from] hdrhistogram::CreationError),
    /// Packets cannot be carried any more.
    #[error("a TUN device can no longer be read")]
    Carry(#[from] io::Error),
}

impl NetemError {
    /// Whether the user can correct it before anything has begun.
    #[must_use]
    pub const fn is_usage(&self) -> bool {
        matches!(self, Self::NotPermitted { .. } | Self::NoTun | Self::Namespaces { .. } | Self::NoIp { .. })
    }
}
