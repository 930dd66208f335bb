//! Machines in namespaces or behind interfaces, and a network between them.

use std::io;
use std::net::IpAddr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use rustix::thread::{CapabilitySet, capabilities};
use thiserror::Error;
use trimaran_netsim::{HostId, Profile};

use super::carrier::{Bound, Cargo, Device};
use super::{Interface, Namespace, Report};

/// How many bits of an address name the network: all machines are neighbours.
const NETWORK_BITS: (u8, u8) = (24, 64);

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
        "{count} namespaces for three machines: name two (the pair's first machine and the display) or three (first, second, display), each once"
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

/// A network between namespaces or interfaces, as long as this lives. Dropping it removes the devices, bridges and namespaces that it
/// made.
#[derive(Debug)]
pub struct Emulation {
    machines: Vec<(HostId, Namespace)>,
    interfaces: Vec<Interface>,
    cargo: Arc<Cargo>,
    stop: Arc<AtomicBool>,
    carrier: Option<JoinHandle<io::Result<()>>>,
}

impl Emulation {
    /// Says what this process lacks for emulating networks between namespaces.
    ///
    /// # Errors
    /// When it lacks something.
    pub fn possible() -> Result<(), NetemError> {
        granted(&[(CapabilitySet::NET_ADMIN, "CAP_NET_ADMIN"), (CapabilitySet::SYS_ADMIN, "CAP_SYS_ADMIN")])
    }

    /// Puts a network between namespaces of these names: those of the pair's first machine, its second and the display, or, if
    /// there are only two, of the first and the display. They are made where they do not exist; their addresses are
    /// [`HostId::v4`] and [`HostId::v6`].
    ///
    /// # Errors
    /// When this process may not do that, or a name or the number of names will not do.
    pub fn start(profile: &Profile, names: &[String], seed: u64) -> Result<Self, NetemError> {
        let (topology, roles) = profile.topology();
        let hosts: &[HostId] = match names {
            [_, _] => &[roles.first, roles.display],
            [_, _, _] => &[roles.first, roles.second, roles.display],
            _ => return Err(NetemError::Namespaces { count: names.len() }),
        };
        if !distinct(names) {
            return Err(NetemError::Namespaces { count: names.len() });
        }
        Self::possible()?;
        let (mut machines, mut devices) = (Vec::new(), Vec::new());
        for (&host, name) in hosts.iter().zip(names) {
            let namespace = Namespace::find_or_make(name)?;
            let addresses: [(IpAddr, u8); 2] = [(host.v4(), NETWORK_BITS.0), (host.v6(), NETWORK_BITS.1)];
            let tun = namespace.add_device(profile.up.mtu, &addresses)?;
            machines.push((host, namespace));
            devices.push(Device { host, tun, bound: Bound::ByAddress });
        }
        let cargo = Cargo::new(topology, seed)?;
        Ok(Self::carrying(cargo, devices, machines, Vec::new()))
    }

    /// Puts a network between two Ethernet interfaces, those of the pair's first machine and of the display: cards with machines behind
    /// them, ends of veth pairs, TAP devices. Whatever comes in at one goes out at the other, of whatever protocol.
    ///
    /// # Errors
    /// When this process may not do that, or an interface will not do.
    pub fn between(profile: &Profile, names: &[String], seed: u64) -> Result<Self, NetemError> {
        let (topology, roles) = profile.topology();
        let ends = match names {
            [first, display] if distinct(names) => {
                [(first, roles.first, roles.display), (display, roles.display, roles.first)]
            }
            _ => return Err(NetemError::Interfaces { count: names.len() }),
        };
        granted(&[(CapabilitySet::NET_ADMIN, "CAP_NET_ADMIN")])?;
        let (mut interfaces, mut devices) = (Vec::new(), Vec::new());
        for (index, (name, host, to)) in ends.into_iter().enumerate() {
            let (interface, tun) = Interface::join(name, index)?;
            interfaces.push(interface);
            devices.push(Device { host, tun, bound: Bound::For(to) });
        }
        let cargo = Cargo::new(topology, seed)?;
        Ok(Self::carrying(cargo, devices, Vec::new(), interfaces))
    }

    /// Begins to carry packets between these devices.
    fn carrying(
        cargo: Cargo,
        devices: Vec<Device>,
        machines: Vec<(HostId, Namespace)>,
        interfaces: Vec<Interface>,
    ) -> Self {
        let (cargo, stop) = (Arc::new(cargo), Arc::new(AtomicBool::new(false)));
        let carrier = thread::spawn({
            let (cargo, stop) = (Arc::clone(&cargo), Arc::clone(&stop));
            move || cargo.carry(&devices, &stop)
        });
        Self { machines, interfaces, cargo, stop, carrier: Some(carrier) }
    }

    /// The machines and where they are.
    #[must_use]
    pub fn machines(&self) -> &[(HostId, Namespace)] {
        &self.machines
    }

    /// The interfaces that are joined.
    #[must_use]
    pub fn interfaces(&self) -> &[Interface] {
        &self.interfaces
    }

    /// What was carried so far.
    #[must_use]
    pub fn report(&self) -> Report {
        self.cargo.report()
    }

    /// Whether packets are still carried; if not, [`Emulation::finish`] says why.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.carrier.as_ref().is_some_and(|carrier| !carrier.is_finished())
    }

    /// Ends it, removes what it made, and says what was carried.
    ///
    /// # Errors
    /// When the carrying had ended by itself.
    pub fn finish(mut self) -> Result<Report, NetemError> {
        self.join()?;
        Ok(self.report())
    }

    fn join(&mut self) -> io::Result<()> {
        self.stop.store(true, Ordering::Relaxed);
        let Some(carrier) = self.carrier.take() else { return Ok(()) };
        carrier.join().unwrap_or_else(|_| Err(io::Error::other("the carrying thread panicked")))
    }
}

/// Whether this process has these capabilities, and the kernel TUN devices.
fn granted(needed: &[(CapabilitySet, &'static str)]) -> Result<(), NetemError> {
    let granted = capabilities(None).map_err(io::Error::from)?.effective;
    for (capability, missing) in needed {
        if !granted.contains(*capability) {
            return Err(NetemError::NotPermitted { missing });
        }
    }
    if Path::new("/dev/net/tun").exists() { Ok(()) } else { Err(NetemError::NoTun) }
}

/// Whether no name is there twice.
fn distinct(names: &[String]) -> bool {
    names.iter().enumerate().all(|(index, name)| !names.iter().take(index).any(|other| other == name))
}

impl Drop for Emulation {
    fn drop(&mut self) {
        let _ended = self.join();
    }
}
