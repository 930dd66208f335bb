//! The inputs of shaders: buffers and constants.

use std::sync::Arc;

use ash::vk;

use crate::error::During as _;
use crate::memory::Buffer;
use crate::{Gpu, GpuError};

/// The stages with buffers and constants.
pub(crate) const STAGES: vk::ShaderStageFlags = vk::ShaderStageFlags::from_raw(
    vk::ShaderStageFlags::VERTEX.as_raw()
        | vk::ShaderStageFlags::FRAGMENT.as_raw()
        | vk::ShaderStageFlags::COMPUTE.as_raw(),
);

/// The inputs of shaders: some storage buffers and some push constants, for all [`STAGES`].
pub(crate) struct Layout {
    gpu: Arc<Gpu>,
    set: vk::DescriptorSetLayout,
    handle: vk::PipelineLayout,
    buffers: u32,
}

impl Layout {
    /// `buffers` storage buffers (perhaps none) at bindings 0 and on, and push constants of the size of `C`.
    pub(crate) fn new<C>(gpu: &Arc<Gpu>, buffers: u32) -> Result<Arc<Self>, GpuError> {
        const OPERATION: &str = "laying out a pipeline";
        let bindings: Vec<_> = (0..buffers)
            .map(|binding| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .descriptor_count(1)
                    .stage_flags(STAGES)
            })
            .collect();
        let constants =
            [vk::PushConstantRange { stage_flags: STAGES, offset: 0, size: size_of::<C>() as u32 }];
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is alive and the bindings are distinct.
        let set = unsafe { gpu.device().create_descriptor_set_layout(&info, None) }.during(OPERATION)?;
        let mut layout = Self { gpu: Arc::clone(gpu), set, handle: vk::PipelineLayout::null(), buffers };
        let sets = [set];
        let info =
            vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&constants);
        // SAFETY: the set layout is ours; all push constants used here are within the 128 bytes every device
        // has.
        layout.handle = unsafe { gpu.device().create_pipeline_layout(&info, None) }.during(OPERATION)?;
        Ok(Arc::new(layout))
    }

    pub(crate) const fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    pub(crate) const fn handle(&self) -> vk::PipelineLayout {
        self.handle
    }
}

impl Drop for Layout {
    fn drop(&mut self) {
        let Some(device) = self.gpu.to_destroy() else { return };
        // SAFETY: both are ours (the second may be null); pipelines hold the layout, so none is in use.
        unsafe {
            device.destroy_pipeline_layout(self.handle, None);
            device.destroy_descriptor_set_layout(self.set, None);
        }
    }
}

/// Buffers bound together. It keeps the buffers alive.
pub(crate) struct BindingSet {
    layout: Arc<Layout>,
    pool: vk::DescriptorPool,
    handle: vk::DescriptorSet,
}

impl BindingSet {
    /// Binds `buffers`, as many as the layout has, in order, each as a whole.
    pub(crate) fn new(layout: &Arc<Layout>, buffers: &[&Buffer]) -> Result<Self, GpuError> {
        const OPERATION: &str = "binding buffers";
        let device = layout.gpu.device();
        let sizes = [vk::DescriptorPoolSize {
            ty: vk::DescriptorType::STORAGE_BUFFER,
            descriptor_count: layout.buffers,
        }];
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: the device is alive.
        let pool = unsafe { device.create_descriptor_pool(&info, None) }.during(OPERATION)?;
        let mut set = Self { layout: Arc::clone(layout), pool, handle: vk::DescriptorSet::null() };
        let layouts = [layout.set];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: the pool has room for one set of this layout.
        let sets = unsafe { device.allocate_descriptor_sets(&info) }.during(OPERATION)?;
        set.handle = sets.first().copied().unwrap_or_default();
        let infos: Vec<_> = buffers
            .iter()
            .map(|buffer| [vk::DescriptorBufferInfo::default().buffer(buffer.handle()).range(vk::WHOLE_SIZE)])
            .collect();
        let writes: Vec<_> = infos
            .iter()
            .zip(0..layout.buffers)
            .map(|(info, binding)| {
                vk::WriteDescriptorSet::default()
                    .dst_set(set.handle)
                    .dst_binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(info)
            })
            .collect();
        // SAFETY: the set is fresh, so not in use; the buffers are alive storage buffers.
        unsafe { device.update_descriptor_sets(&writes, &[]) };
        Ok(set)
    }

    pub(crate) const fn handle(&self) -> vk::DescriptorSet {
        self.handle
    }
}

impl Drop for BindingSet {
    fn drop(&mut self) {
        let Some(device) = self.layout.gpu.to_destroy() else { return };
        // SAFETY: work that uses the set is done, as for the buffers it binds; the set goes with its pool.
        unsafe { device.destroy_descriptor_pool(self.pool, None) };
    }
}
