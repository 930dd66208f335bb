//! An open device.

use parking_lot::{Mutex, MutexGuard};
use std::mem::ManuallyDrop;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ash::vk;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings};

use crate::adapter::{Adapter, Limits};
use crate::needs;
use crate::validation::{self, Messenger};
use crate::{DeviceChoice, GpuError, GpuInfo, Optional};

/// How to open a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GpuOptions {
    /// Whether the Khronos validation layer checks every call, synchronization included. Slow; for tests.
    pub validation: bool,
    /// Whether each culler on a device with f64 traverses the tree on it, whatever its kind, and compares
    /// each traversal with the host's: see [`CullError::Differs`](trimaran_cull::CullError::Differs) and
    /// [`OccluderError::Differs`](trimaran_cull::OccluderError::Differs).
    pub check_traversals: bool,
    /// Which device.
    pub device: DeviceChoice,
    /// The most memory of the device for a scene's triangles, in bytes. They are loaded and dropped as
    /// needed; a frame that needs more than fits is drawn in parts. `None`: three quarters of the free
    /// memory, allocated as needed. An explicit amount is allocated at once.
    pub memory: Option<u64>,
    /// The time limit of one submission of a pass, after which the device counts as hung: see
    /// [`GpuError::DeviceHung`].
    pub timeout: Duration,
}

impl GpuOptions {
    /// The default timeout. A submission is at most some millions of triangles: seconds for a slow CPU
    /// driver.
    pub const TIMEOUT: Duration = Duration::from_secs(30);
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self {
            validation: false,
            check_traversals: false,
            device: DeviceChoice::Best,
            memory: None,
            timeout: Self::TIMEOUT,
        }
    }
}

/// An open Vulkan device without a window. Passes and scenes share it through an [`Arc`]; threads may too.
///
/// A hung device and all objects made from it are never destroyed: Vulkan forbids destroying objects in use,
/// and a driver would wait for ever. They are leaked on purpose until the process ends, the scene's memory
/// included. A process that outlives a hung device, by opening another, pays with this memory.
pub struct Gpu {
    // Dropped by hand, in this order: the allocator's memory, the device, the messenger, the instance, the
    // loader.
    allocator: ManuallyDrop<Mutex<Allocator>>,
    device: ash::Device,
    messenger: ManuallyDrop<Option<Messenger>>,
    instance: ash::Instance,
    #[cfg(feature = "window")]
    physical: vk::PhysicalDevice,
    queue: Mutex<vk::Queue>,
    queue_family: u32,
    info: GpuInfo,
    limits: Limits,
    memory: Option<u64>,
    check_traversals: bool,
    timeout: Duration,
    /// The device has exceeded the timeout.
    hung: AtomicBool,
    /// Work may be running that is no longer waited for.
    abandoned: AtomicBool,
    entry: ManuallyDrop<ash::Entry>,
}

impl Gpu {
    /// Opens a device.
    ///
    /// # Errors
    /// The missing loader, device or feature, and the package that has it.
    pub fn open(options: &GpuOptions) -> Result<Arc<Self>, GpuError> {
        Self::open_with(options, &[])
    }

    /// Opens a device that can show pictures in windows of a display.
    ///
    /// # Errors
    /// Those of [`open`](Self::open), and if Vulkan does not support windows of the display here.
    #[cfg(feature = "window")]
    pub fn open_for_windows(
        options: &GpuOptions,
        display: raw_window_handle::DisplayHandle<'_>,
    ) -> Result<Arc<Self>, GpuError> {
        let surfaces =
            ash_window::enumerate_required_extensions(display.as_raw()).map_err(|_| GpuError::NoWindows)?;
        Self::open_with(options, surfaces)
    }

    /// Opens a device of an instance with these extensions for windows. Without extensions it shows none.
    pub(crate) fn open_with(
        options: &GpuOptions,
        surfaces: &[*const std::ffi::c_char],
    ) -> Result<Arc<Self>, GpuError> {
        let (entry, instance) = instance(options.validation, surfaces)?;
        // From here on a failure has to destroy existing objects.
        let opened = Self::open_on(&entry, &instance, options, !surfaces.is_empty());
        match opened {
            Ok(parts) => Ok(Arc::new(parts.into_gpu(entry, instance, options))),
            Err(error) => {
                // SAFETY: all that was made from the instance is gone: `open_on` leaves nothing behind when
                // it fails.
                unsafe { instance.destroy_instance(None) };
                Err(error)
            }
        }
    }

    /// The machine's devices with their missing features, best first, for a diagnosis.
    ///
    /// # Errors
    /// If there is no loader, or it cannot list devices. No device at all is an empty list.
    pub fn list() -> Result<Vec<GpuInfo>, GpuError> {
        let (_entry, instance) = instance(false, &[])?;
        let adapters = Adapter::all(&instance, false);
        // SAFETY: nothing was made from the instance.
        unsafe { instance.destroy_instance(None) };
        Ok(adapters?.into_iter().map(|adapter| adapter.info).collect())
    }

    /// The device's properties.
    #[must_use]
    pub const fn info(&self) -> &GpuInfo {
        &self.info
    }

    /// All messages of the validation layer; empty without validation.
    #[must_use]
    pub fn validation_messages(&self) -> Vec<String> {
        self.messenger.as_ref().map(Messenger::messages).unwrap_or_default()
    }

    pub(crate) const fn device(&self) -> &ash::Device {
        &self.device
    }

    /// The loader, the instance and the physical device, for presentation in windows.
    #[cfg(feature = "window")]
    pub(crate) fn platform(&self) -> (&ash::Entry, &ash::Instance, vk::PhysicalDevice) {
        (&self.entry, &self.instance, self.physical)
    }

    pub(crate) const fn limits(&self) -> &Limits {
        &self.limits
    }

    /// From here on it is a device without timestamps.
    #[cfg(test)]
    pub(crate) const fn forget_timestamps(&mut self) {
        self.limits.timestamp_period_ns = 0.0;
    }

    /// The time limit of one submission.
    pub(crate) const fn timeout(&self) -> Duration {
        self.timeout
    }

    /// Whether traversals on the device are compared with the host's.
    #[must_use]
    pub const fn checks_traversals(&self) -> bool {
        self.check_traversals
    }

    /// Whether the device has hung before.
    pub(crate) fn is_hung(&self) -> bool {
        self.hung.load(Ordering::Relaxed)
    }

    /// Marks that work may still run without being waited for: nothing made from the device is destroyed from
    /// here on.
    pub(crate) fn abandon(&self, hung: bool) {
        self.abandoned.store(true, Ordering::Relaxed);
        self.hung.fetch_or(hung, Ordering::Relaxed);
    }

    /// The device, to destroy an object that work used. `None` if that work may still run: then the object
    /// must be leaked.
    pub(crate) fn to_destroy(&self) -> Option<&ash::Device> {
        (!self.abandoned.load(Ordering::Relaxed)).then_some(&self.device)
    }

    /// The requested memory limit of a scene's triangles.
    pub(crate) const fn memory_budget(&self) -> Option<u64> {
        self.memory
    }

    /// Free memory of the device's own when it was opened, in bytes.
    pub(crate) const fn free_memory(&self) -> u64 {
        self.limits.free_memory
    }

    /// Whether shaders that need the triangle's number fetch vertices themselves.
    pub(crate) fn fetches_vertices(&self) -> bool {
        self.info.lacks.contains(&Optional::GeometryShader)
    }

    pub(crate) const fn queue_family(&self) -> u32 {
        self.queue_family
    }

    pub(crate) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock()
    }

    /// The queue, for one thread at a time as Vulkan demands.
    pub(crate) fn queue(&self) -> MutexGuard<'_, vk::Queue> {
        self.queue.lock()
    }

    fn open_on(
        entry: &ash::Entry,
        instance: &ash::Instance,
        options: &GpuOptions,
        presents: bool,
    ) -> Result<Parts, GpuError> {
        let messenger = options.validation.then(|| Messenger::new(entry, instance)).transpose()?;
        let adapter = Adapter::choose(instance, &options.device, presents)?;
        for lack in &adapter.info.lacks {
            tracing::info!(device = adapter.info.name, lacks = lack.name(), "{}", lack.without());
        }
        let Adapter { physical, queue_family, .. } = adapter;
        let device = needs::open(instance, physical, queue_family, &adapter.info.lacks, presents)?;
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.clone(),
            device: device.clone(),
            physical_device: adapter.physical,
            debug_settings: AllocatorDebugSettings::default(),
            buffer_device_address: false,
            allocation_sizes: AllocationSizes::new(BLOCK_BYTES, BLOCK_BYTES),
        });
        match allocator {
            Ok(allocator) => Ok(Parts { allocator, device, messenger, adapter }),
            Err(source) => {
                // SAFETY: the device is idle: nothing was submitted.
                unsafe { device.destroy_device(None) };
                Err(GpuError::Allocation { what: "the allocator", bytes: 0, source })
            }
        }
    }
}

/// Small allocations share blocks of this size; large ones get their own memory.
const BLOCK_BYTES: u64 = 16 << 20;

/// The objects made by opening, except the instance.
struct Parts {
    allocator: Allocator,
    device: ash::Device,
    messenger: Option<Messenger>,
    adapter: Adapter,
}

impl Parts {
    fn into_gpu(self, entry: ash::Entry, instance: ash::Instance, options: &GpuOptions) -> Gpu {
        let queue_family = self.adapter.queue_family;
        // SAFETY: the device was made with one queue of this family.
        let queue = unsafe { self.device.get_device_queue(queue_family, 0) };
        Gpu {
            allocator: ManuallyDrop::new(Mutex::new(self.allocator)),
            device: self.device,
            messenger: ManuallyDrop::new(self.messenger),
            instance,
            #[cfg(feature = "window")]
            physical: self.adapter.physical,
            queue: Mutex::new(queue),
            queue_family,
            info: self.adapter.info,
            limits: self.adapter.limits,
            memory: options.memory,
            check_traversals: options.check_traversals,
            timeout: options.timeout,
            hung: AtomicBool::new(false),
            abandoned: AtomicBool::new(false),
            entry: ManuallyDrop::new(entry),
        }
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        if self.to_destroy().is_none() {
            return; // leaked, the loaded driver included: see the type
        }
        // SAFETY: every object made from the device holds an `Arc` of this `Gpu` and is gone by now, so
        // nothing runs on the device and nothing uses it; allocator, device, messenger, instance and
        // loader go in the order of their dependence, each once.
        unsafe {
            ManuallyDrop::drop(&mut self.allocator);
            self.device.destroy_device(None);
            ManuallyDrop::drop(&mut self.messenger);
            self.instance.destroy_instance(None);
            ManuallyDrop::drop(&mut self.entry);
        }
    }
}

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Gpu").field("info", &self.info).finish_non_exhaustive()
    }
}

fn instance(
    validation: bool,
    surfaces: &[*const std::ffi::c_char],
) -> Result<(ash::Entry, ash::Instance), GpuError> {
    // SAFETY: loads the system's Vulkan loader, whose initialisers are sound to run; the entry outlives all
    // made from it.
    let entry = unsafe { ash::Entry::load() }.map_err(GpuError::NoLoader)?;
    let application =
        vk::ApplicationInfo::default().application_name(c"trimaran").api_version(vk::API_VERSION_1_3);
    let layers = [validation::LAYER.as_ptr()];
    let checking = [ash::ext::debug_utils::NAME.as_ptr(), ash::ext::validation_features::NAME.as_ptr()];
    let extensions: Vec<_> =
        surfaces.iter().copied().chain(checking.into_iter().filter(|_| validation)).collect();
    let checks = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
    let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
    let mut info =
        vk::InstanceCreateInfo::default().application_info(&application).enabled_extension_names(&extensions);
    if validation {
        info = info.enabled_layer_names(&layers).push_next(&mut features);
    }
    // SAFETY: all that `info` points to lives through the call.
    match unsafe { entry.create_instance(&info, None) } {
        Ok(instance) => Ok((entry, instance)),
        Err(vk::Result::ERROR_LAYER_NOT_PRESENT) => Err(GpuError::NoValidationLayer),
        Err(vk::Result::ERROR_EXTENSION_NOT_PRESENT) if surfaces.is_empty() => {
            Err(GpuError::NoValidationLayer)
        }
        Err(vk::Result::ERROR_EXTENSION_NOT_PRESENT) => Err(GpuError::NoWindows),
        // A loader without any driver returns this.
        Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER) => Err(GpuError::NoDevice),
        Err(code) => Err(GpuError::from_vk("starting Vulkan", code)),
    }
}
