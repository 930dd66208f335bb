//! The machine's devices and their missing features.

use std::ffi::CStr;

use ash::vk;
use trimaran_cull::SubPixelGrid;

use crate::error::During as _;
use crate::gpu_info::{DeviceKind, GpuInfo, HzbPlace};
use crate::needs::{self, Answer};
use crate::{DeviceChoice, DeviceUuid, GpuError, Optional, PciAddress};

/// A device, with the data needed to open it.
pub(crate) struct Adapter {
    pub(crate) physical: vk::PhysicalDevice,
    pub(crate) queue_family: u32,
    pub(crate) info: GpuInfo,
    pub(crate) limits: Limits,
}

/// Further limits that matter to passes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// The largest range of a storage buffer.
    pub(crate) max_storage_range: u64,
    /// The most storage buffers that a shader binds.
    pub(crate) max_storage_buffers: u32,
    /// Nanoseconds a tick of the timestamp counter; 0 if the queue has no timestamps.
    pub(crate) timestamp_period_ns: f64,
    /// Free memory of the device's own, in bytes.
    pub(crate) free_memory: u64,
}

impl Adapter {
    /// All devices, best first; suitable ones before others. If `presents`, they need the features for
    /// windows as well.
    pub(crate) fn all(instance: &ash::Instance, presents: bool) -> Result<Vec<Self>, GpuError> {
        // SAFETY: the instance is alive.
        let found = unsafe { instance.enumerate_physical_devices() };
        let found = match found {
            // A loader without any driver returns this code.
            Err(vk::Result::ERROR_INITIALIZATION_FAILED) => Vec::new(),
            other => other.during("listing the Vulkan devices")?,
        };
        let mut adapters: Vec<_> =
            found.into_iter().map(|device| Self::inspect(instance, device, presents)).collect();
        adapters.sort_by_key(|a| (!a.info.missing.is_empty(), std::cmp::Reverse(a.info.kind)));
        Ok(adapters)
    }

    /// The adapter to open.
    pub(crate) fn choose(
        instance: &ash::Instance,
        choice: &DeviceChoice,
        presents: bool,
    ) -> Result<Self, GpuError> {
        let adapters = Self::all(instance, presents)?;
        let infos: Vec<_> = adapters.iter().map(|adapter| adapter.info.clone()).collect();
        let number = choice.place(&infos)?;
        let adapter = adapters.into_iter().nth(number).ok_or(GpuError::NoDevice)?;
        let GpuInfo { name, uuid, pci, .. } = &adapter.info;
        let pci = pci.map(tracing::field::display);
        tracing::info!(device = name, number, %uuid, pci, "opens the graphics device");
        Ok(adapter)
    }

    fn inspect(instance: &ash::Instance, physical: vk::PhysicalDevice, presents: bool) -> Self {
        let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut ids = vk::PhysicalDeviceIDProperties::default();
        let mut bus = vk::PhysicalDevicePCIBusInfoPropertiesEXT::default();
        let mut properties = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut maintenance)
            .push_next(&mut driver)
            .push_next(&mut ids);
        let tells_bus = needs::has_extension(instance, physical, ash::ext::pci_bus_info::NAME);
        if tells_bus {
            properties = properties.push_next(&mut bus);
        }
        // SAFETY: `physical` was enumerated from this instance; the chain holds structures of Vulkan 1.1 and
        // 1.2 that older devices leave untouched, and one of an extension that the device has.
        let (families, memory) = unsafe {
            instance.get_physical_device_properties2(physical, &mut properties);
            (
                instance.get_physical_device_queue_family_properties(physical),
                instance.get_physical_device_memory_properties(physical),
            )
        };
        let properties = properties.properties;
        let limits = properties.limits;
        let kind = DeviceKind::from_vk(properties.device_type);
        let version = properties.api_version;
        let queue_family = families.iter().position(|family| family.queue_flags.contains(needs::QUEUE));
        let family = queue_family.and_then(|family| families.get(family));
        let Answer { missing, lacks } = needs::ask(instance, physical, &properties, family, presents);
        let timestamps = !lacks.contains(&Optional::Timestamps);
        let max_side = limits
            .max_framebuffer_width
            .min(limits.max_framebuffer_height)
            .min(limits.max_viewport_dimensions[0])
            .min(limits.max_viewport_dimensions[1])
            .min(limits.max_image_dimension2_d);
        let local_heaps = memory
            .memory_heaps_as_slice()
            .iter()
            .filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        Self {
            physical,
            queue_family: queue_family.unwrap_or(0) as u32,
            limits: Limits {
                max_storage_range: u64::from(limits.max_storage_buffer_range),
                max_storage_buffers: limits.max_per_stage_descriptor_storage_buffers,
                timestamp_period_ns: if timestamps { f64::from(limits.timestamp_period) } else { 0.0 },
                free_memory: needs::free_memory(instance, physical),
            },
            info: GpuInfo {
                name: text(properties.device_name_as_c_str()),
                driver: format!(
                    "{} {}",
                    text(driver.driver_name_as_c_str()),
                    text(driver.driver_info_as_c_str())
                ),
                api_version: (
                    vk::api_version_major(version),
                    vk::api_version_minor(version),
                    vk::api_version_patch(version),
                ),
                kind,
                vendor: properties.vendor_id,
                uuid: DeviceUuid(ids.device_uuid),
                pci: tells_bus.then_some(PciAddress {
                    domain: bus.pci_domain,
                    bus: bus.pci_bus,
                    device: bus.pci_device,
                    function: bus.pci_function,
                }),
                max_viewport: max_side,
                max_allocation: maintenance.max_memory_allocation_size,
                memory: local_heaps.map(|heap| heap.size).max().unwrap_or(0),
                missing,
                sub_pixel_grid: SubPixelGrid::of_bits(limits.sub_pixel_precision_bits),
                hzb_place: HzbPlace::best(kind, &lacks),
                lacks,
            },
        }
    }
}

impl HzbPlace {
    fn best(kind: DeviceKind, lacks: &[Optional]) -> Self {
        if kind == DeviceKind::Discrete && !lacks.contains(&Optional::Float64) {
            Self::Device
        } else {
            Self::Host
        }
    }
}

impl DeviceKind {
    const fn from_vk(kind: vk::PhysicalDeviceType) -> Self {
        match kind {
            vk::PhysicalDeviceType::DISCRETE_GPU => Self::Discrete,
            vk::PhysicalDeviceType::INTEGRATED_GPU => Self::Integrated,
            vk::PhysicalDeviceType::VIRTUAL_GPU => Self::Virtual,
            vk::PhysicalDeviceType::CPU => Self::Cpu,
            _ => Self::Other,
        }
    }
}

fn text<E>(name: Result<&CStr, E>) -> String {
    name.map_or_else(|_| "unnamed".to_owned(), |name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::{DeviceKind, HzbPlace, Optional};

    #[test]
    fn only_a_gpu_with_memory_of_its_own_and_f64_tests_boxes_itself() {
        use DeviceKind::{Cpu, Discrete, Integrated, Other, Virtual};
        for kind in [Other, Cpu, Virtual, Integrated] {
            assert_eq!(HzbPlace::best(kind, &[]), HzbPlace::Host);
        }
        assert_eq!(HzbPlace::best(Discrete, &[Optional::Timestamps]), HzbPlace::Device);
        assert_eq!(HzbPlace::best(Discrete, &[Optional::Float64]), HzbPlace::Host);
    }
}
