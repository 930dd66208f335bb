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

/// Where iproute2 keeps named namespaces.
const FOLDER: &str = "/run/netns";
/// The name of a namespace's device in it.
const DEVICE: &str = "net0";
/// The queue length of a device, packets: enough while a busy machine delays the reader.
pub(super) const DEVICE_QUEUE: u32 = 10_000;

/// A named network namespace, as `ip netns` makes them. One that was made here is removed on drop; one that
/// was there before stays.
#[derive(Debug)]
pub struct Namespace {
    name: String,
    /// The namespace itself: it exists while this is open, with or without its name.
    file: File,
    made: bool,
}

impl Namespace {
    /// The namespace of that name, made if it does not exist.
    ///
    /// # Errors
    /// When it does not exist and iproute2 cannot make it.
    pub fn find_or_make(name: &str) -> Result<Self, NetemError> {
        let made = !path(name).exists();
        if made {
            ip(&["netns", "add", name])?;
        }
        let file = File::open(path(name))
            .map_err(|cause| NetemError::Namespace { namespace: name.to_owned(), cause })?;
        Ok(Self { name: name.to_owned(), file, made })
    }

    /// Removes its name, if it was made here. Then it ends with this process, however that ends, and nobody
    /// else can enter it any more.
    ///
    /// # Errors
    /// When iproute2 fails.
    pub fn take_name(&mut self) -> Result<(), NetemError> {
        if self.made {
            ip(&["netns", "delete", &self.name])?;
            self.made = false;
        }
        Ok(())
    }

    /// Its name.
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

    /// Adds a TUN device with these addresses, each with its prefix length.
    pub(super) fn add_device(&self, mtu: u32, addresses: &[(IpAddr, u8)]) -> Result<SyncDevice, NetemError> {
        let name = &self.name;
        let failed = |cause| NetemError::Device { namespace: name.clone(), cause };
        // A device belongs to the namespace of the thread that makes it; its file works from any thread.
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
