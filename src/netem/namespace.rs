//! Network namespaces and the devices in them.

use std::fs::File;
use std::io;
use std::net::IpAddr;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::thread;

use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};
use tun_rs::{DeviceBuilder, SyncDevice};

use super::NetemError;
use super::iproute::ip;

/// Where iproute2 keeps the namespaces that have names.
const FOLDER: &str = "/run/netns";
/// What the device of a namespace is called in it.
const DEVICE: &str = "net0";
/// How many packets wait in a device for whoever reads it: more than come while a busy machine runs something
/// else.
pub(super) const DEVICE_QUEUE: u32 = 10_000;

/// A network namespace with a name, as `ip netns` makes them. One that was made is removed when this is
/// dropped; one that was there before stays.
#[derive(Debug)]
pub struct Namespace {
    name: String,
    /// The namespace itself: it is there as long as this is open, with or without its name.
    file: File,
    made: bool,
}

impl Namespace {
    /// The namespace of that name, made if there is none.
    ///
    /// # Errors
    /// When there is none and iproute2 cannot make it.
    pub fn find_or_make(name: &str) -> Result<Self, NetemError> {
        let made = !path(name).exists();
        if made {
            ip(&["netns", "add", name])?;
        }
        let file = File::open(path(name))
            .map_err(|cause| NetemError::Namespace { namespace: name.to_owned(), cause })?;
        Ok(Self { name: name.to_owned(), file, made })
    }

    /// Takes its name from it, if it was made here: it ends with this process then, however that ends, and
    /// nobody else can enter it any more.
    ///
    /// # Errors
    /// When iproute2 cannot.
    pub fn take_name(&mut self) -> Result<(), NetemError> {
        if self.made {
            ip(&["netns", "delete", &self.name])?;
            self.made = false;
        }
        Ok(())
    }

    /// What it is called.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Moves the calling thread into the namespace, and with it the sockets that the thread opens from now
    /// on.
    ///
    /// # Errors
    /// When this process may not enter it.
    pub fn enter(&self) -> io::Result<()> {
        Ok(move_into_link_name_space(self.file.as_fd(), Some(LinkNameSpaceType::Network))?)
    }

    /// Adds a TUN device with these addresses, each in a network of that many bits.
    pub(super) fn add_device(&self, mtu: u32, addresses: &[(IpAddr, u8)]) -> Result<SyncDevice, NetemError> {
        let name = &self.name;
        let failed = |cause| NetemError::Device { namespace: name.clone(), cause };
        // A device belongs to the namespace of the thread that makes it; the file that carries its packets to
        // any thread.
        let build = || {
            self.enter()?;
            DeviceBuilder::new().name(DEVICE).tx_queue_len(DEVICE_QUEUE).enable(false).build_sync()
        };
        let device = thread::scope(|scope| scope.spawn(build).join())
            .unwrap_or_else(|_| Err(io::Error::other("the thread that made it panicked")))
            .map_err(failed)?;
        device.set_nonblocking(true).map_err(failed)?;
        for (address, bits) in addresses {
            let network = format!("{address}/{bits}");
            let mut words = vec!["-n", name, "address", "add", &network, "dev", DEVICE];
            if address.is_ipv6() {
                words.push("nodad"); // nobody else is there: no need to wait for objections
            }
            ip(&words)?;
        }
        ip(&["-n", name, "link", "set", DEVICE, "mtu", &mtu.to_string(), "up"])?;
        ip(&["-n", name, "link", "set", "lo", "up"])?;
        Ok(device)
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        if self.made
            && let Err(e) = ip(&["netns", "delete", &self.name])
        {
            tracing::warn!(error = &e as &dyn std::error::Error, "the namespace {} stays", self.name);
        }
    }
}

fn path(name: &str) -> PathBuf {
    Path::new(FOLDER).join(name)
}
