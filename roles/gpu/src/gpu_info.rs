//! The properties of a device.

use trimaran_cull::SubPixelGrid;

use crate::device_id::{DeviceUuid, PciAddress};
use crate::needs::Optional;

/// The kind of a device, worst first, so that the best one is the greatest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum DeviceKind {
    /// A kind unknown to Vulkan.
    Other,
    /// A driver that draws on the CPU.
    Cpu,
    /// A device behind a hypervisor.
    Virtual,
    /// A GPU that shares the CPU's memory.
    Integrated,
    /// A GPU with memory of its own.
    Discrete,
}

/// The properties of a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GpuInfo {
    /// The device's name.
    pub name: String,
    /// The driver's name and version, as reported by the driver.
    pub driver: String,
    /// The Vulkan version it speaks: major, minor, patch.
    pub api_version: (u32, u32, u32),
    /// Its kind.
    pub kind: DeviceKind,
    /// Its vendor's PCI number, such as 0x10de for NVIDIA.
    pub vendor: u32,
    /// Its UUID: the same each time, as long as driver and machine are the same.
    pub uuid: DeviceUuid,
    /// Its PCI address, if it has one and its driver tells it.
    pub pci: Option<PciAddress>,
    /// The longest side of a picture, in pixels.
    pub max_viewport: u32,
    /// The largest single allocation, in bytes.
    pub max_allocation: u64,
    /// Memory of its own, in bytes (the largest device-local heap).
    pub memory: u64,
    /// The missing required features, by Vulkan's own names. Such a device cannot be opened.
    pub missing: Vec<&'static str>,
    /// The missing optional features.
    pub lacks: Vec<Optional>,
    /// The grid of its rasterizer.
    pub sub_pixel_grid: SubPixelGrid,
    /// The better place for the depth pyramid's box tests.
    pub hzb_place: HzbPlace,
}

/// Where boxes are tested against a depth pyramid. Both give the same answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum HzbPlace {
    /// On the host, by `trimaran_cull::HzbTest`: one copy of the depth replaces a wait for the device at each
    /// level of the tree. Best where host and device share memory.
    Host,
    /// On the device, by [`DeviceHzbTest`](crate::DeviceHzbTest): no picture crosses the bus.
    Device,
}

/// A device as it is listed, on this PCI bus. Its UUID begins with the bus.
#[cfg(test)]
pub(crate) fn listed(name: &str, bus: Option<u8>) -> GpuInfo {
    let mut uuid = [name.len() as u8; 16];
    uuid[0] = bus.unwrap_or_default();
    GpuInfo {
        name: name.to_owned(),
        driver: String::new(),
        api_version: (1, 3, 0),
        kind: DeviceKind::Discrete,
        vendor: if name.starts_with("NVIDIA") { 0x10de } else { 0x1002 },
        uuid: DeviceUuid(uuid),
        pci: bus.map(|bus| PciAddress { domain: 0, bus: bus.into(), device: 0, function: 0 }),
        max_viewport: 16_384,
        max_allocation: 1 << 30,
        memory: 1 << 30,
        missing: Vec::new(),
        lacks: Vec::new(),
        sub_pixel_grid: SubPixelGrid::default(),
        hzb_place: HzbPlace::Device,
    }
}
