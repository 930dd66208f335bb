//! An Ethernet interface that exists, whose frames are carried elsewhere.

use std::process;

use serde::Deserialize;
use tun_rs::{DeviceBuilder, Layer, SyncDevice};

use super::NetemError;
use super::iproute::ip;
use super::namespace::DEVICE_QUEUE;

/// Joins an interface by a bridge of the kernel to a TAP device, so that every frame that comes in at the
/// interface can be read there, and what is written there goes out. A packet socket would see frames as the
/// kernel keeps them inside, merged and without their checksums; at a TAP device it finishes them first.
/// Dropping this removes both and leaves the interface as it was.
#[derive(Debug)]
pub struct Interface {
    name: String,
    bridge: String,
}

/// What `ip -j address show` says of an interface.
#[derive(Debug, Deserialize)]
struct Shown {
    link_type: String,
    mtu: u32,
    master: Option<String>,
    #[serde(default)]
    addr_info: Vec<Address>,
}

#[derive(Debug, Deserialize)]
struct Address {
    local: String,
    scope: String,
}

impl Interface {
    /// Joins the interface `name` to a device, number `index` of this process's.
    ///
    /// # Errors
    /// When there is no such interface, it is not one of Ethernet, or it has another use.
    pub(super) fn join(name: &str, index: usize) -> Result<(Self, SyncDevice), NetemError> {
        let Shown { mtu, .. } = Shown::free(name)?;
        let [bridge, tap] = ["br", "tap"].map(|kind| format!("tm{kind}{index}-{}", process::id()));
        ip(&["link", "add", &bridge, "type", "bridge"])?;
        // From here on an early end removes the bridge.
        let interface = Self { name: name.to_owned(), bridge };
        let bridge = interface.bridge.as_str();
        let device = DeviceBuilder::new()
            .name(&tap)
            .layer(Layer::L2)
            .tx_queue_len(DEVICE_QUEUE)
            .enable(false)
            .build_sync()
            .and_then(|device| device.set_nonblocking(true).map(|()| device))
            .map_err(|cause| NetemError::Tap { name: name.to_owned(), cause })?;
        for part in [bridge, &tap] {
            // They are no machines: they have no addresses, and ask nobody for any.
            ip(&["link", "set", part, "addrgenmode", "none"])?;
            ip(&["link", "set", part, "mtu", &mtu.to_string()])?;
        }
        for port in [name, &tap] {
            ip(&["link", "set", port, "master", bridge])?;
        }
        for part in [name, &tap, bridge] {
            ip(&["link", "set", part, "up"])?;
        }
        Ok((interface, device))
    }

    /// What it is called.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl Drop for Interface {
    fn drop(&mut self) {
        // The interface comes free with it, and the TAP device goes with whoever holds it open.
        if let Err(e) = ip(&["link", "delete", &self.bridge]) {
            tracing::warn!(error = &e as &dyn std::error::Error, "the bridge {} stays", self.bridge);
        }
    }
}

impl Shown {
    /// The interface of that name, if it can be taken.
    fn free(name: &str) -> Result<Self, NetemError> {
        let missing = || NetemError::NoInterface { name: name.to_owned() };
        let text = match ip(&["-j", "address", "show", "dev", name]) {
            Err(NetemError::Ip { .. }) => return Err(missing()),
            said => said?,
        };
        let all: Vec<Self> = serde_json::from_str(&text)
            .map_err(|cause| NetemError::Shown { name: name.to_owned(), cause })?;
        let shown = all.into_iter().next().ok_or_else(missing)?;
        if shown.link_type != "ether" {
            let kind = shown.link_type;
            return Err(NetemError::NotEthernet { name: name.to_owned(), kind });
        }
        if let Some(master) = shown.master {
            return Err(NetemError::Taken { name: name.to_owned(), master });
        }
        if let Some(address) = shown.addr_info.iter().find(|address| address.scope != "link") {
            let address = address.local.clone();
            return Err(NetemError::InUse { name: name.to_owned(), address });
        }
        Ok(shown)
    }
}
