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

/// Why this machine cannot do it, if it cannot.
pub(crate) fn possible() -> Result<(), String> {
    if !rustix::process::geteuid().is_root() {
        return Err("network namespaces need root".to_owned());
    }
    if !std::path::Path::new("/dev/net/tun").exists() {
        return Err("there is no /dev/net/tun".to_owned());
    }
    ip(&["-V"]).map_err(|e| format!("the program `ip` (package iproute2) does not run: {e}"))
}

/// Two namespaces and the devices in them. Dropping it removes both.
pub(crate) struct Path {
    names: [String; 2],
    pub(crate) devices: [Arc<SyncDevice>; 2],
}

impl Path {
    /// Lays it; TCP at both ends controls congestion as is said, or as the system does.
    pub(crate) fn lay(congestion: Option<&str>) -> io::Result<Self> {
        let names = ["a", "b"].map(|end| format!("trimaran-{}-{end}", std::process::id()));
        let device = |end: &str| DeviceBuilder::new().name(format!("tri{}", end)).build_sync().map(Arc::new);
        let path = Self { devices: [device("a")?, device("b")?], names };
        for (end, name) in path.names.iter().enumerate() {
            let (here, there) = (ADDRESSES[end], ADDRESSES[1 - end]);
            let device = path.devices[end].name()?;
            ip(&["netns", "add", name])?;
            ip(&["link", "set", &device, "netns", name])?;
            ip(&["-n", name, "address", "add", here, "peer", there, "dev", &device])?;
            ip(&["-n", name, "link", "set", &device, "mtu", "1500", "up"])?;
            // Linux lets a route say so.
            if let Some(congestion) = congestion {
                ip(&["-n", name, "route", "replace", there, "dev", &device, "congctl", congestion])?;
            }
        }
        Ok(path)
    }

    /// Moves this thread, and the sockets that it opens, into the namespace of an end.
    pub(crate) fn enter(&self, end: usize) -> io::Result<()> {
        let file = File::open(format!("/run/netns/{}", self.names[end]))?;
        Ok(move_into_link_name_space(file.as_fd(), Some(LinkNameSpaceType::Network))?)
    }
}

impl Drop for Path {
    fn drop(&mut self) {
        for name in &self.names {
            if let Err(e) = ip(&["netns", "delete", name]) {
                eprintln!("{e}");
            }
        }
    }
}

fn ip(args: &[&str]) -> io::Result<()> {
    let output = Command::new("ip").args(args).output()?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(io::Error::other(format!("ip {}: {}", args.join(" "), said.trim())))
}
