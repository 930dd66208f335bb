//! Pipelines made of shaders.

use std::ffi::CStr;
use std::mem::offset_of;
use std::sync::Arc;

use ash::vk;
use trimaran_cull::grid_bias_px;
use trimaran_scene::Vertex;

use crate::boxes::BoxRecord;
use crate::draw_record::DrawRecord;
use crate::error::During as _;
use crate::layout::Layout;
use crate::{Gpu, GpuError};

/// One compiled entry point.
#[derive(Clone, Copy)]
pub(crate) struct Shader {
    pub(crate) spirv: &'static [u8],
    pub(crate) entry: &'static CStr,
}

/// The entry point `$name` as the build script compiled it.
macro_rules! shader {
    ($name:literal) => {
        $crate::pipeline::Shader {
            spirv: include_bytes!(concat!(env!("OUT_DIR"), "/", $name, ".spv")),
            entry: {
                const NAME: &[u8] = concat!($name, "\0").as_bytes();
                match ::std::ffi::CStr::from_bytes_with_nul(NAME) {
                    Ok(name) => name,
                    Err(_) => c"",
                }
            },
        }
    };
}
pub(crate) use shader;

/// The vertex and instance inputs of a vertex shader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum VertexInput {
    /// None: the shader makes a triangle.
    Nothing,
    /// No vertices, which the shader makes, but one box per instance.
    Box,
    /// The position, and the draw's matrix.
    Position,
    /// These, and the vertex's colour and normal.
    Facet,
    /// The position, the draw's matrix and id.
    Id,
    /// No vertices, which the shader fetches by the draw's first index and vertex, but its matrix and id.
    PulledId,
}

impl VertexInput {
    /// Whether it is for draws of a scene.
    fn is_of_a_scene(self) -> bool {
        !matches!(self, Self::Nothing | Self::Box)
    }
}

/// A pipeline's use of the depth buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DepthUse {
    /// Keeps the nearest surface.
    Draw,
    /// The same, but moves surfaces away by [`grid_bias_px`].
    Occlude,
    /// Passes fragments nearer than the surface or level with it, without writing depth.
    Test,
    /// Passes fragments nearer than the surface, blended over the picture, without writing depth.
    SeeThrough,
}

/// The opacity of a see-through surface at a pixel. A colour with a smaller alpha has that instead. The
/// shaders have the same constant.
pub const SEE_THROUGH_ALPHA: f32 = 0.3;

/// The varying parts of pipelines. All share the rest: triangles, reversed-z depth test.
pub(crate) struct PipelineDesc {
    pub(crate) vertex: Shader,
    pub(crate) fragment: Option<Shader>,
    pub(crate) input: VertexInput,
    pub(crate) colour: Option<vk::Format>,
    pub(crate) depth: DepthUse,
}

/// A pipeline for graphics or for computing.
pub(crate) struct Pipeline {
    layout: Arc<Layout>,
    handle: vk::Pipeline,
    bind_point: vk::PipelineBindPoint,
}

impl Pipeline {
    pub(crate) fn new(layout: &Arc<Layout>, desc: &PipelineDesc) -> Result<Self, GpuError> {
        let vertex = Module::new(layout.gpu(), desc.vertex)?;
        let fragment = desc.fragment.map(|shader| Module::new(layout.gpu(), shader)).transpose()?;
        let mut stages = vec![vertex.stage(vk::ShaderStageFlags::VERTEX)];
        stages.extend(fragment.iter().map(|module| module.stage(vk::ShaderStageFlags::FRAGMENT)));

        let (bindings, attributes) = vertex_input(desc.input);
        let input = vk::PipelineVertexInputStateCreateInfo::default()
            .vertex_binding_descriptions(&bindings)
            .vertex_attribute_descriptions(&attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default()
            .topology(vk::PrimitiveTopology::TRIANGLE_LIST);
        let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
        let raster = vk::PipelineRasterizationStateCreateInfo::default()
            .polygon_mode(vk::PolygonMode::FILL)
            .cull_mode(vk::CullModeFlags::NONE) // of boxes; each run of draws sets its own
            .front_face(vk::FrontFace::COUNTER_CLOCKWISE)
            .depth_bias_enable(desc.depth == DepthUse::Occlude)
            .depth_bias_slope_factor(-grid_bias_px(layout.gpu().info().sub_pixel_grid)) // depth is reversed
            .line_width(1.0);
        let samples = vk::PipelineMultisampleStateCreateInfo::default()
            .rasterization_samples(vk::SampleCountFlags::TYPE_1);
        // Of equal depths the first drawn stays, in every pass alike; but a box level with a surface is
        // visible.
        let (depth_write, compare) = match desc.depth {
            DepthUse::Draw | DepthUse::Occlude => (true, vk::CompareOp::GREATER),
            DepthUse::Test => (false, vk::CompareOp::GREATER_OR_EQUAL),
            DepthUse::SeeThrough => (false, vk::CompareOp::GREATER),
        };
        let depth = vk::PipelineDepthStencilStateCreateInfo::default()
            .depth_test_enable(true)
            .depth_write_enable(depth_write)
            .depth_compare_op(compare);
        let formats: Vec<_> = desc.colour.into_iter().collect();
        let writes: Vec<_> = formats
            .iter()
            .map(|_| {
                vk::PipelineColorBlendAttachmentState::default()
                    .blend_enable(desc.depth == DepthUse::SeeThrough)
                    .src_color_blend_factor(vk::BlendFactor::SRC_ALPHA)
                    .dst_color_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)
                    // The picture stays opaque.
                    .src_alpha_blend_factor(vk::BlendFactor::ZERO)
                    .dst_alpha_blend_factor(vk::BlendFactor::ONE)
                    .color_write_mask(vk::ColorComponentFlags::RGBA)
            })
            .collect();
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&writes);
        let mut dynamic_states = vec![vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
        if desc.input.is_of_a_scene() {
            dynamic_states.push(vk::DynamicState::CULL_MODE);
        }
        let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic_states);
        let mut rendering = vk::PipelineRenderingCreateInfo::default()
            .color_attachment_formats(&formats)
            .depth_attachment_format(vk::Format::D32_SFLOAT);
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&raster)
            .multisample_state(&samples)
            .depth_stencil_state(&depth)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(layout.handle())
            .push_next(&mut rendering);
        // SAFETY: all that `info` points to lives through the call; the shaders were validated when they were
        // compiled and use no more than the layout and the enabled features give.
        let made = unsafe {
            layout.gpu().device().create_graphics_pipelines(vk::PipelineCache::null(), &[info], None)
        };
        Self::of(layout, made, vk::PipelineBindPoint::GRAPHICS)
    }

    /// A compute pipeline.
    pub(crate) fn compute(layout: &Arc<Layout>, shader: Shader) -> Result<Self, GpuError> {
        let module = Module::new(layout.gpu(), shader)?;
        let info = vk::ComputePipelineCreateInfo::default()
            .stage(module.stage(vk::ShaderStageFlags::COMPUTE))
            .layout(layout.handle());
        // SAFETY: the module lives through the call; the shader was validated when it was compiled and uses
        // no more than the layout and the enabled features give.
        let made = unsafe {
            layout.gpu().device().create_compute_pipelines(vk::PipelineCache::null(), &[info], None)
        };
        Self::of(layout, made, vk::PipelineBindPoint::COMPUTE)
    }

    fn of(
        layout: &Arc<Layout>,
        made: Result<Vec<vk::Pipeline>, (Vec<vk::Pipeline>, vk::Result)>,
        bind_point: vk::PipelineBindPoint,
    ) -> Result<Self, GpuError> {
        let handles = made.map_err(|(_, code)| GpuError::from_vk("making a pipeline", code))?;
        let handle = handles.first().copied().unwrap_or_default();
        Ok(Self { layout: Arc::clone(layout), handle, bind_point })
    }

    pub(crate) const fn bind_point(&self) -> vk::PipelineBindPoint {
        self.bind_point
    }

    pub(crate) const fn handle(&self) -> vk::Pipeline {
        self.handle
    }

    pub(crate) fn layout(&self) -> &Layout {
        &self.layout
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        let Some(device) = self.layout.gpu().to_destroy() else { return };
        // SAFETY: the stream that used it is done: owners declare their stream first.
        unsafe { device.destroy_pipeline(self.handle, None) };
    }
}

/// The binding of vertices, and that of instances: draws or boxes.
pub(crate) const VERTICES: u32 = 0;
pub(crate) const INSTANCES: u32 = 1;

type Bindings = Vec<vk::VertexInputBindingDescription>;
type Attributes = Vec<vk::VertexInputAttributeDescription>;

fn vertex_input(input: VertexInput) -> (Bindings, Attributes) {
    let vertices = vk::VertexInputBindingDescription {
        binding: VERTICES,
        stride: size_of::<Vertex>() as u32,
        input_rate: vk::VertexInputRate::VERTEX,
    };
    let row = |index| {
        let offset = offset_of!(DrawRecord, to_view) + index * size_of::<[f32; 4]>();
        attribute(2 + index as u32, INSTANCES, vk::Format::R32G32B32A32_SFLOAT, offset)
    };
    let position = attribute(0, VERTICES, vk::Format::R32G32B32_SFLOAT, offset_of!(Vertex, position));
    let colour = attribute(1, VERTICES, vk::Format::R8G8B8A8_UNORM, offset_of!(Vertex, colour));
    let normal = attribute(6, VERTICES, vk::Format::R16G16_SNORM, offset_of!(Vertex, normal));
    let id = attribute(5, INSTANCES, vk::Format::R32_UINT, offset_of!(DrawRecord, id));
    let first = attribute(7, INSTANCES, vk::Format::R32G32_UINT, offset_of!(DrawRecord, first));
    let own = match input {
        VertexInput::Nothing => return (vec![], vec![]),
        VertexInput::Box => return (vec![instances::<BoxRecord>()], box_attributes()),
        VertexInput::Position => vec![position],
        VertexInput::Facet => vec![position, colour, normal],
        VertexInput::Id => vec![position, id],
        VertexInput::PulledId => vec![id, first],
    };
    let draws = instances::<DrawRecord>();
    let bindings = if input == VertexInput::PulledId { vec![draws] } else { vec![vertices, draws] };
    (bindings, [vec![row(0), row(1), row(2)], own].concat())
}

/// `Box` of boxes.wgsl.
fn box_attributes() -> Attributes {
    let axis = |index| {
        let offset = offset_of!(BoxRecord, axes) + index * size_of::<[f32; 3]>();
        attribute(2 + index as u32, INSTANCES, vk::Format::R32G32B32_SFLOAT, offset)
    };
    let centre = attribute(0, INSTANCES, vk::Format::R32G32B32_SFLOAT, offset_of!(BoxRecord, centre));
    let faces = attribute(1, INSTANCES, vk::Format::R32_UINT, offset_of!(BoxRecord, faces));
    vec![centre, faces, axis(0), axis(1), axis(2)]
}

const fn instances<T>() -> vk::VertexInputBindingDescription {
    vk::VertexInputBindingDescription {
        binding: INSTANCES,
        stride: size_of::<T>() as u32,
        input_rate: vk::VertexInputRate::INSTANCE,
    }
}

const fn attribute(
    location: u32,
    binding: u32,
    format: vk::Format,
    offset: usize,
) -> vk::VertexInputAttributeDescription {
    vk::VertexInputAttributeDescription { location, binding, format, offset: offset as u32 }
}

/// A shader module, needed only while pipelines are made of it.
struct Module<'a> {
    gpu: &'a Gpu,
    handle: vk::ShaderModule,
    entry: &'static CStr,
}

impl<'a> Module<'a> {
    fn new(gpu: &'a Gpu, shader: Shader) -> Result<Self, GpuError> {
        let words: Vec<u32> =
            shader.spirv.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the words are SPIR-V that naga wrote from a validated module.
        let handle = unsafe { gpu.device().create_shader_module(&info, None) }.during("loading a shader")?;
        Ok(Self { gpu, handle, entry: shader.entry })
    }

    fn stage(&self, stage: vk::ShaderStageFlags) -> vk::PipelineShaderStageCreateInfo<'_> {
        vk::PipelineShaderStageCreateInfo::default().stage(stage).module(self.handle).name(self.entry)
    }
}

impl Drop for Module<'_> {
    fn drop(&mut self) {
        // SAFETY: ours; pipelines do not need it once they are made.
        unsafe { self.gpu.device().destroy_shader_module(self.handle, None) };
    }
}
