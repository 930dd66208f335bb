//! Machines in namespaces, and a network between them.

use std::io;
use std::net::IpAddr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use rustix::thread::{CapabilitySet, capabilities};
use trimaran_actors::CullerId;
use trimaran_netsim::{HostId, Profile};

use super::carrier::{Cargo, Device};
use super::{Namespace, NetemError, Report};
use crate::session_hosts::SessionHosts;

/// The network bits of an address: all machines are neighbours.
const NETWORK_BITS: (u8, u8) = (24, 64);

/// A network between namespaces, as long as this lives. Dropping it removes the devices and namespaces that
/// it made.
#[derive(Debug)]
pub struct Emulation {
    machines: Vec<(HostId, Namespace)>,
    cargo: Arc<Cargo>,
    stop: Arc<AtomicBool>,
    carrier: Option<JoinHandle<io::Result<()>>>,
}

impl Emulation {
    /// Checks whether this process can emulate networks between namespaces.
    ///
    /// # Errors
    /// The missing privilege or program.
    pub fn possible() -> Result<(), NetemError> {
        let granted = capabilities(None).map_err(io::Error::from)?.effective;
        for (capability, missing) in
            [(CapabilitySet::NET_ADMIN, "CAP_NET_ADMIN"), (CapabilitySet::SYS_ADMIN, "CAP_SYS_ADMIN")]
        {
            if !granted.contains(capability) {
                return Err(NetemError::NotPermitted { missing });
            }
        }
        if Path::new("/dev/net/tun").exists() { Ok(()) } else { Err(NetemError::NoTun) }
    }

    /// Puts a network between namespaces of these names: those of cullers, and last the display's. They are
    /// made where they do not exist; their addresses are [`HostId::v4`] and [`HostId::v6`].
    ///
    /// # Errors
    /// When this process may not do that, or a name or the number of names is invalid.
    pub fn start(profile: &Profile, names: &[String], seed: u64) -> Result<Self, NetemError> {
        if !(2..=1 + CullerId::MOST).contains(&names.len()) || !distinct(names) {
            return Err(NetemError::Namespaces { count: names.len() });
        }
        let (topology, SessionHosts { cullers, display }) = SessionHosts::on(profile, names.len() - 1);
        Self::possible()?;
        let (mut machines, mut devices) = (Vec::new(), Vec::new());
        for (host, name) in cullers.into_iter().chain([display]).zip(names) {
            let namespace = Namespace::find_or_make(name)?;
            let addresses: [(IpAddr, u8); 2] = [(host.v4(), NETWORK_BITS.0), (host.v6(), NETWORK_BITS.1)];
            let tun = namespace.add_device(profile.up.mtu, &addresses)?;
            machines.push((host, namespace));
            devices.push(Device { host, tun });
        }
        let (cargo, stop) = (Arc::new(Cargo::new(topology, seed)?), Arc::new(AtomicBool::new(false)));
        let carrier = thread::spawn({
            let (cargo, stop) = (Arc::clone(&cargo), Arc::clone(&stop));
            move || cargo.carry(&devices, &stop)
        });
        Ok(Self { machines, cargo, stop, carrier: Some(carrier) })
    }

    /// The machines and their namespaces.
    #[must_use]
    pub fn machines(&self) -> &[(HostId, Namespace)] {
        &self.machines
    }

    /// Removes the names of the namespaces that were made, for a program that plays all machines itself. So
    /// nothing stays behind, however it ends.
    ///
    /// # Errors
    /// When iproute2 fails.
    pub fn take_names(&mut self) -> Result<(), NetemError> {
        self.machines.iter_mut().try_for_each(|(_, namespace)| namespace.take_name())
    }

    /// The counters so far.
    #[must_use]
    pub fn report(&self) -> Report {
        self.cargo.report()
    }

    /// Whether packets are still carried; if not, [`Emulation::finish`] says why.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.carrier.as_ref().is_some_and(|carrier| !carrier.is_finished())
    }

    /// Ends it, removes what it made, and returns the counters.
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

/// Whether all names differ.
fn distinct(names: &[String]) -> bool {
    names.iter().enumerate().all(|(index, name)| !names.iter().take(index).any(|other| other == name))
}

impl Drop for Emulation {
    fn drop(&mut self) {
        let _ended = self.join();
    }
}
