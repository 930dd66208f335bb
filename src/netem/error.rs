//! Why a network cannot be emulated.

use std::io;

use thiserror::Error;

/// Why a network cannot be emulated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NetemError {
    /// This process may not.
    #[error(
        "emulating a network makes network namespaces and TUN devices, which takes the capabilities CAP_NET_ADMIN and, for namespaces, CAP_SYS_ADMIN, and {missing} is missing: run it as root"
    )]
    NotPermitted {
        /// What it lacks.
        missing: &'static str,
    },
    /// The kernel has no TUN devices.
    #[error("there is no /dev/net/tun: load the kernel's module `tun`, or let the container have the device")]
    NoTun,
    /// More or fewer namespaces than machines.
    #[error(
        "{count} namespaces for three machines: name two (the first culler and the display) or three (first, second, display), each once"
    )]
    Namespaces {
        /// How many were given.
        count: usize,
    },
    /// Two interfaces are joined, neither more nor fewer.
    #[error("{count} interfaces to put a network between: name two, each once")]
    Interfaces {
        /// How many were given.
        count: usize,
    },
    /// No such interface.
    #[error("there is no network interface {name}: `ip link` lists those that there are")]
    NoInterface {
        /// What it would be called.
        name: String,
    },
    /// The interface carries no Ethernet frames.
    #[error(
        "{name} carries no Ethernet frames ({kind}): name an Ethernet card, one end of a veth pair or a TAP device"
    )]
    NotEthernet {
        /// The interface.
        name: String,
        /// What it is.
        kind: String,
    },
    /// The interface belongs to another bridge.
    #[error("{name} belongs to {master} already: free it with `ip link set {name} nomaster`")]
    Taken {
        /// The interface.
        name: String,
        /// The bridge.
        master: String,
    },
    /// This machine speaks over the interface itself.
    #[error(
        "{name} has the address {address} of this machine, which nobody could reach any more: name another interface, or remove it with `ip address flush dev {name}`"
    )]
    InUse {
        /// The interface.
        name: String,
        /// Its address.
        address: String,
    },
    /// iproute2 speaks of an interface in words that are not known.
    #[error("what `ip -j address show dev {name}` says is not understood")]
    Shown {
        /// The interface.
        name: String,
        /// What is wrong.
        #[source]
        cause: serde_json::Error,
    },
    /// The device for an interface's frames could not be made.
    #[error("cannot make a TAP device for the frames of {name}")]
    Tap {
        /// The interface.
        name: String,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// iproute2 is not there.
    #[error("the program `ip` does not run: install the package iproute2")]
    NoIp {
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// iproute2 could not do it.
    #[error("`ip {command}` failed: {said}")]
    Ip {
        /// The command.
        command: String,
        /// What it said.
        said: String,
    },
    /// What is called a namespace cannot be opened.
    #[error("cannot open the network namespace {namespace}")]
    Namespace {
        /// Which.
        namespace: String,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
    /// A device could not be made.
    #[error("cannot make a TUN device in the namespace {namespace}")]
    Device {
        /// Where.
        namespace: String,
        /// What the system says.
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
    /// Whether the user can do something about it before anything is tried.
    #[must_use]
    pub const fn is_usage(&self) -> bool {
        matches!(
            self,
            Self::NotPermitted { .. }
                | Self::NoTun
                | Self::Namespaces { .. }
                | Self::Interfaces { .. }
                | Self::NoInterface { .. }
                | Self::NotEthernet { .. }
                | Self::Taken { .. }
                | Self::InUse { .. }
                | Self::NoIp { .. }
        )
    }
}
