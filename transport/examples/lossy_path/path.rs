//! Two network namespaces with a TUN device each.

use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::process::Command;
use std::sync::Arc;

use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};
use tun_rs::{DeviceBuilder, SyncDevice};

/// The addresses of the sender and of the receiver.
pub(crate) const ADDRESSES: [&str; 2] = ["10.99.0.1", "10.99.0.2"];

/// Why this machine cannot do it, if so.
pub(crate) fn possible() -> Result<(), String> {
    if !rustix::process::geteuid().is_root() {
        return Err("network namespaces need root".to_owned());
    }
    if !std::path::Path::new("/dev/net/tun").exists() {
        return Err("there is no /dev/net/tun".to_owned());
    }
    ip(&["-V"]).map_err(|e| format!("the program `ip` (package iproute2) does not run: {e}"))
}

/// Two namespaces and the devices in them. They have no names, so that they end with this value, or with the
/// process, however that ends.
pub(crate) struct Path {
    places: [File; 2],
    pub(crate) devices: [Arc<SyncDevice>; 2],
}

impl Path {
    /// Sets it up; `congestion` names TCP's congestion control at both ends, otherwise the system chooses.
    pub(crate) fn lay(congestion: Option<&str>) -> io::Result<Self> {
        let end = |index: usize| {
            // iproute2 enters a namespace by its name; the open file keeps it.
            let name = format!("trimaran-{}-{index}", std::process::id());
            // A killed run may have left one of that number.
            let _none = ip(&["netns", "delete", &name]);
            ip(&["netns", "add", &name])?;
            let device = File::open(format!("/run/netns/{name}"))
                .and_then(|place| Ok((place, furnish(&name, index, congestion)?)));
            ip(&["netns", "delete", &name])?;
            device
        };
        let ((here, near), (there, far)) = (end(0)?, end(1)?);
        Ok(Self { places: [here, there], devices: [near, far] })
    }

    /// Moves this thread, and the sockets that it opens, into the namespace of an end.
    pub(crate) fn enter(&self, end: usize) -> io::Result<()> {
        Ok(move_into_link_name_space(self.places[end].as_fd(), Some(LinkNameSpaceType::Network))?)
    }
}

/// Makes the device of the namespace that is called `name` for now.
fn furnish(name: &str, index: usize, congestion: Option<&str>) -> io::Result<Arc<SyncDevice>> {
    let (here, there) = (ADDRESSES[index], ADDRESSES[1 - index]);
    let device = DeviceBuilder::new().name(format!("tri{index}")).build_sync()?;
    let device_name = device.name()?;
    ip(&["link", "set", &device_name, "netns", name])?;
    ip(&["-n", name, "address", "add", here, "peer", there, "dev", &device_name])?;
    ip(&["-n", name, "link", "set", &device_name, "mtu", "1500", "up"])?;
    // Linux sets congestion control by route.
    if let Some(congestion) = congestion {
        ip(&["-n", name, "route", "replace", there, "dev", &device_name, "congctl", congestion])?;
    }
    Ok(Arc::new(device))
}

fn ip(args: &[&str]) -> io::Result<()> {
    let output = Command::new("ip").args(args).output()?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(io::Error::other(format!("ip {}: {}", args.join(" "), said.trim())))
}
