//! The requirements on a device: all features, extensions and formats that this crate uses, with the effect
//! of missing optional ones.
//!
//! The limits that it checks are [`Limits`](crate::adapter::Limits); for all others it stays far below
//! Vulkan's guaranteed minimum (128 bytes of push constants, 16 vertex attributes, 128 invocations in a
//! workgroup, 65,535 draws in an indirect call, 128 MiB in a storage buffer that tests count in).

use std::ffi::CStr;

use ash::vk;

use crate::GpuError;
use crate::error::During as _;

/// An optional feature.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Optional {
    /// The feature that gives primitive ids to fragment shaders.
    GeometryShader,
    /// The clock of the graphics queue.
    Timestamps,
    /// f64 in shaders.
    Float64,
}

impl Optional {
    /// Its name, Vulkan's own.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::GeometryShader => "geometryShader",
            Self::Timestamps => "timestampValidBits",
            Self::Float64 => "shaderFloat64",
        }
    }

    /// The effect of its absence.
    #[must_use]
    pub const fn without(self) -> &'static str {
        match self {
            Self::GeometryShader => {
                "audits fetch vertices from storage buffers, which is slower; walks are as fast as with it"
            }
            Self::Timestamps => "reports lack device times of passes",
            Self::Float64 => "hzb tests boxes on the host, which costs where the depth crosses a bus",
        }
    }
}

/// The missing features of a device.
pub(crate) struct Answer {
    /// The missing required features, by Vulkan's own names.
    pub(crate) missing: Vec<&'static str>,
    /// The missing optional features.
    pub(crate) lacks: Vec<Optional>,
}

/// The required operations of the one queue. A device that draws has a family with both.
pub(crate) const QUEUE: vk::QueueFlags =
    vk::QueueFlags::from_raw(vk::QueueFlags::GRAPHICS.as_raw() | vk::QueueFlags::COMPUTE.as_raw());

/// Checks a device for all of it. `family` is that of its graphics queue, if it has one.
pub(crate) fn ask(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    properties: &vk::PhysicalDeviceProperties,
    family: Option<&vk::QueueFamilyProperties>,
    presents: bool,
) -> Answer {
    let (mut missing, core) = features(instance, physical, properties.api_version);
    if family.is_none() {
        missing.push("a graphics queue");
    }
    if !draws_depth(instance, physical) {
        missing.push("D32_SFLOAT as depth attachment");
    }
    if presents && !has_extension(instance, physical, ash::khr::swapchain::NAME) {
        missing.push("VK_KHR_swapchain");
    }
    let lacks = [
        (core.geometry_shader == vk::TRUE, Optional::GeometryShader),
        (family.is_none_or(|family| family.timestamp_valid_bits > 0), Optional::Timestamps),
        (core.shader_float64 == vk::TRUE, Optional::Float64),
    ];
    let lacks = lacks.into_iter().filter(|(has, _)| !has).map(|(_, optional)| optional).collect();
    Answer { missing, lacks }
}

/// A logical device with one graphics queue and all required features: the list of [`features`], enabled.
pub(crate) fn open(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    queue_family: u32,
    lacks: &[Optional],
    presents: bool,
) -> Result<ash::Device, GpuError> {
    let priorities = [1.0];
    let queues =
        [vk::DeviceQueueCreateInfo::default().queue_family_index(queue_family).queue_priorities(&priorities)];
    let features = vk::PhysicalDeviceFeatures::default()
        // Every device has it; an index beyond the vertices then reads something harmless.
        .robust_buffer_access(true)
        .occlusion_query_precise(true)
        .multi_draw_indirect(true)
        .draw_indirect_first_instance(true)
        .fragment_stores_and_atomics(true)
        .geometry_shader(!lacks.contains(&Optional::GeometryShader))
        .shader_float64(!lacks.contains(&Optional::Float64));
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default().timeline_semaphore(true);
    let mut v13 =
        vk::PhysicalDeviceVulkan13Features::default().synchronization2(true).dynamic_rendering(true);
    let swapchains = [ash::khr::swapchain::NAME.as_ptr()];
    let info = vk::DeviceCreateInfo::default()
        .enabled_extension_names(if presents { &swapchains } else { &[] })
        .queue_create_infos(&queues)
        .enabled_features(&features)
        .push_next(&mut v12)
        .push_next(&mut v13);
    // SAFETY: the device is of this instance and has the queue family and each of these features: the caller
    // has asked (`ask`) and nothing required was missing.
    unsafe { instance.create_device(physical, &info, None) }.during("opening the device")
}

/// The missing required features, and the core ones that the device has.
fn features(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    version: u32,
) -> (Vec<&'static str>, vk::PhysicalDeviceFeatures) {
    if version < vk::API_VERSION_1_3 {
        return (vec!["Vulkan 1.3"], vk::PhysicalDeviceFeatures::default());
    }
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut all = vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut v13);
    // SAFETY: the device speaks Vulkan 1.3, so both structures of the chain are its own.
    unsafe { instance.get_physical_device_features2(physical, &mut all) };
    let core = all.features;
    let required = [
        (core.occlusion_query_precise, "occlusionQueryPrecise"),
        (core.multi_draw_indirect, "multiDrawIndirect"),
        (core.draw_indirect_first_instance, "drawIndirectFirstInstance"),
        (core.fragment_stores_and_atomics, "fragmentStoresAndAtomics"),
        (v12.timeline_semaphore, "timelineSemaphore"),
        (v13.synchronization2, "synchronization2"),
        (v13.dynamic_rendering, "dynamicRendering"),
    ];
    let missing = required.into_iter().filter(|(has, _)| *has == vk::FALSE).map(|(_, name)| name);
    (missing.collect(), core)
}

/// Whether the depth format can be drawn to: the only used format that Vulkan leaves optional.
fn draws_depth(instance: &ash::Instance, physical: vk::PhysicalDevice) -> bool {
    // SAFETY: `physical` was enumerated from this instance.
    let depth = unsafe { instance.get_physical_device_format_properties(physical, vk::Format::D32_SFLOAT) };
    depth
        .optimal_tiling_features
        .contains(vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT | vk::FormatFeatureFlags::TRANSFER_SRC)
}

/// Whether the device has an extension.
pub(crate) fn has_extension(instance: &ash::Instance, physical: vk::PhysicalDevice, name: &CStr) -> bool {
    // SAFETY: `physical` was enumerated from this instance.
    let extensions = unsafe { instance.enumerate_device_extension_properties(physical) };
    extensions.unwrap_or_default().iter().any(|extension| extension.extension_name_as_c_str() == Ok(name))
}

/// Free memory of the device's own, in bytes, as reported by the driver, or else all of it.
pub(crate) fn free_memory(instance: &ash::Instance, physical: vk::PhysicalDevice) -> u64 {
    let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
    let mut properties = vk::PhysicalDeviceMemoryProperties2::default();
    let tells = has_extension(instance, physical, ash::ext::memory_budget::NAME);
    if tells {
        properties = properties.push_next(&mut budget);
    }
    // SAFETY: as above, and the device has the extension that the chained structure belongs to.
    unsafe { instance.get_physical_device_memory_properties2(physical, &mut properties) };
    let memory = properties.memory_properties;
    let heaps = memory.memory_heaps_as_slice().iter().enumerate();
    let own = heaps.filter(|(_, heap)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
    let free = |(index, heap): (usize, &vk::MemoryHeap)| match (tells, budget.heap_budget.get(index)) {
        (true, Some(allowed)) => {
            allowed.saturating_sub(budget.heap_usage.get(index).copied().unwrap_or(0)).min(heap.size)
        }
        _ => heap.size,
    };
    own.map(free).max().unwrap_or(0)
}
