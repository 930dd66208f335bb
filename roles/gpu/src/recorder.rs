//! Recording commands: the few that the passes use, typed.
//!
//! Every method here records into a command buffer that [`Stream::submit`](crate::stream::Stream::submit) has
//! begun. Each call is sound for the same reason: handles come from living wrappers, and the stream's owner
//! keeps these alive until the stream is done.

use std::ops::Range;

use ash::vk;
use trimaran_cull::{Facing, Viewport};

use crate::draw_record::{DrawCommand, Fetch};
use crate::layout::{BindingSet, STAGES};
use crate::memory::{Buffer, HostBuffer, Image, ImageUse, layers, whole};
use crate::pipeline::{INSTANCES, Pipeline, VERTICES};
use crate::scope::{self, Scope};
use crate::timestamps::PieceTimestamps;
use crate::timing::Pass;

/// A command buffer being recorded.
pub(crate) struct Recorder<'a> {
    device: &'a ash::Device,
    commands: vk::CommandBuffer,
    /// If the commands are timed.
    timestamps: Option<&'a PieceTimestamps<'a>>,
}

/// The attachments of a render pass, and how it begins.
pub(crate) struct Targets<'a> {
    pub(crate) size: Viewport,
    pub(crate) colour: Option<(&'a mut Image, vk::ClearColorValue)>,
    pub(crate) depth: &'a mut Image,
    /// Whether to clear both first (depth to 0, the far end), or to keep their content.
    pub(crate) clear: bool,
}

impl<'a> Recorder<'a> {
    pub(crate) const fn new(
        device: &'a ash::Device,
        commands: vk::CommandBuffer,
        timestamps: Option<&'a PieceTimestamps<'a>>,
    ) -> Self {
        Self { device, commands, timestamps }
    }

    /// Counts the time from here on as that of `pass`: once in a piece of work. It is exact if a barrier
    /// follows.
    pub(crate) fn begin_pass(&self, pass: Pass) {
        if let Some(timestamps) = self.timestamps {
            timestamps.begin(Some(pass));
        }
    }

    /// Runs `draw` inside a render pass over the targets.
    pub(crate) fn render(&self, targets: Targets<'_>, draw: impl FnOnce()) {
        let Targets { size, colour, depth, clear } = targets;
        let load_op = if clear { vk::AttachmentLoadOp::CLEAR } else { vk::AttachmentLoadOp::LOAD };
        self.hand_over(depth, ImageUse::Depth, clear);
        let depth_info = vk::RenderingAttachmentInfo::default()
            .image_view(depth.view())
            .image_layout(ImageUse::Depth.layout())
            .load_op(load_op)
            .store_op(vk::AttachmentStoreOp::STORE)
            .clear_value(vk::ClearValue {
                depth_stencil: vk::ClearDepthStencilValue { depth: 0.0, stencil: 0 },
            });
        let colours: Vec<_> = colour
            .into_iter()
            .map(|(image, background)| {
                self.hand_over(image, ImageUse::Colour, clear);
                vk::RenderingAttachmentInfo::default()
                    .image_view(image.view())
                    .image_layout(ImageUse::Colour.layout())
                    .load_op(load_op)
                    .store_op(vk::AttachmentStoreOp::STORE)
                    .clear_value(vk::ClearValue { color: background })
            })
            .collect();
        let extent = vk::Extent2D { width: size.width(), height: size.height() };
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent };
        let info = vk::RenderingInfo::default()
            .render_area(area)
            .layer_count(1)
            .color_attachments(&colours)
            .depth_attachment(&depth_info);
        let viewport = vk::Viewport {
            x: 0.0,
            y: 0.0,
            width: size.width() as f32,
            height: size.height() as f32,
            min_depth: 0.0,
            max_depth: 1.0,
        };
        // SAFETY: the module's rule; the attachments are in the layouts named and of the size named.
        unsafe {
            self.device.cmd_begin_rendering(self.commands, &info);
            self.device.cmd_set_viewport(self.commands, 0, &[viewport]);
            self.device.cmd_set_scissor(self.commands, 0, &[area]);
        }
        draw();
        // SAFETY: a render pass was begun above, and nothing else ends one.
        unsafe { self.device.cmd_end_rendering(self.commands) };
    }

    /// Uses this pipeline and these constants from here on.
    pub(crate) fn bind<C: bytemuck::NoUninit>(&self, pipeline: &Pipeline, constants: &C) {
        // SAFETY: the module's rule; the layout's push constants are of this size (`Layout::new`).
        unsafe {
            self.device.cmd_bind_pipeline(self.commands, pipeline.bind_point(), pipeline.handle());
            self.device.cmd_push_constants(
                self.commands,
                pipeline.layout().handle(),
                STAGES,
                0,
                bytemuck::bytes_of(constants),
            );
        }
    }

    /// Uses these buffers from here on.
    pub(crate) fn bind_set(&self, pipeline: &Pipeline, set: &BindingSet) {
        // SAFETY: the module's rule; sets and pipelines that meet here share a layout.
        unsafe {
            self.device.cmd_bind_descriptor_sets(
                self.commands,
                pipeline.bind_point(),
                pipeline.layout().handle(),
                0,
                &[set.handle()],
                &[],
            );
        }
    }

    /// Uses these vertices and 32-bit indices, in one buffer, from here on.
    pub(crate) fn bind_mesh(&self, geometry: &Buffer) {
        // SAFETY: the module's rule; the buffer was made with both usages.
        unsafe {
            self.device.cmd_bind_vertex_buffers(self.commands, VERTICES, &[geometry.handle()], &[0]);
            self.device.cmd_bind_index_buffer(self.commands, geometry.handle(), 0, vk::IndexType::UINT32);
        }
    }

    /// Uses these instance attributes from here on.
    pub(crate) fn bind_instances(&self, instances: &Buffer) {
        // SAFETY: the module's rule; the buffer was made with this usage.
        unsafe { self.device.cmd_bind_vertex_buffers(self.commands, INSTANCES, &[instances.handle()], &[0]) };
    }

    /// Draws these sides of triangles from here on, with a pipeline for the draws of a scene.
    pub(crate) fn face(&self, facing: Facing) {
        let hidden = match facing {
            Facing::Both => vk::CullModeFlags::NONE,
            Facing::Front => vk::CullModeFlags::BACK,
            Facing::Mirrored => vk::CullModeFlags::FRONT,
        };
        // SAFETY: the module's rule; Vulkan 1.3 has this state, which such a pipeline leaves to the commands.
        unsafe { self.device.cmd_set_cull_mode(self.commands, hidden) };
    }

    /// Draws these commands of `commands` in one call.
    pub(crate) fn draw_indirect(&self, fetch: Fetch, commands: &Buffer, which: Range<usize>) {
        let stride = size_of::<DrawCommand>();
        let (offset, count, stride) = ((which.start * stride) as u64, which.len() as u32, stride as u32);
        // SAFETY: the module's rule; callers pass ranges inside the buffer, and no more than a chunk, which
        // is below every device's maxDrawIndirectCount (65535 at least with multiDrawIndirect).
        unsafe {
            match fetch {
                Fetch::Fixed => self.device.cmd_draw_indexed_indirect(
                    self.commands,
                    commands.handle(),
                    offset,
                    count,
                    stride,
                ),
                Fetch::Pulled => {
                    self.device.cmd_draw_indirect(self.commands, commands.handle(), offset, count, stride);
                }
            }
        }
    }

    /// Draws `vertices` vertices for each of `instances`, without a mesh.
    pub(crate) fn draw(&self, vertices: u32, instances: Range<u32>) {
        // SAFETY: the module's rule; the pipeline bound takes instance attributes alone, and callers bind as
        // many instances.
        unsafe {
            self.device.cmd_draw(
                self.commands,
                vertices,
                instances.end - instances.start,
                0,
                instances.start,
            );
        }
    }

    /// Runs the bound compute shader, in this many workgroups across and down; outside of a render pass.
    pub(crate) fn dispatch(&self, groups: [u32; 2]) {
        // SAFETY: the module's rule; a compute pipeline and its buffers are bound, and the groups are far
        // fewer than the 65,535 a side that every device takes.
        unsafe { self.device.cmd_dispatch(self.commands, groups[0], groups[1], 1) };
    }

    /// The same, where the workgroups across, down and deep stand in a buffer.
    pub(crate) fn dispatch_indirect(&self, buffer: &Buffer, offset: u64) {
        // SAFETY: the module's rule; the buffer was made with this usage, the three words lie within it at a
        // multiple of 4, and shaders write no more groups than every device takes.
        unsafe { self.device.cmd_dispatch_indirect(self.commands, buffer.handle(), offset) };
    }

    /// Resets queries; outside of a render pass.
    pub(crate) fn reset_queries(&self, pool: vk::QueryPool, count: u32) {
        // SAFETY: the module's rule; the pool has at least `count` queries, none of them in use.
        unsafe { self.device.cmd_reset_query_pool(self.commands, pool, 0, count) };
    }

    /// Counts precisely the samples that `draw` passes.
    pub(crate) fn query(&self, pool: vk::QueryPool, index: u32, draw: impl FnOnce()) {
        // SAFETY: the module's rule; the query lies in the pool and was reset, occlusionQueryPrecise is
        // enabled, and begin and end lie in one render pass.
        unsafe {
            self.device.cmd_begin_query(self.commands, pool, index, vk::QueryControlFlags::PRECISE);
            draw();
            self.device.cmd_end_query(self.commands, pool, index);
        }
    }

    /// Copies a whole image into a host-visible buffer as [`copy_image`](Self::copy_image) does, and makes it
    /// visible to the host.
    pub(crate) fn copy_to_host(&self, image: &mut Image, size: Viewport, buffer: &Buffer) {
        self.copy_image(image, size, buffer);
        self.barrier(scope::COPY_WRITE, scope::HOST_READ);
    }

    /// Fills an image of a window with a whole image, and makes it ready to be presented. If the sizes
    /// differ, the image is scaled with linear filtering.
    #[cfg(feature = "window")]
    pub(crate) fn fill_window(
        &self,
        image: &mut Image,
        size: Viewport,
        shown: vk::Image,
        extent: vk::Extent2D,
    ) {
        self.hand_over(image, ImageUse::CopySource, false);
        let (written, present) = (vk::ImageLayout::TRANSFER_DST_OPTIMAL, vk::ImageLayout::PRESENT_SRC_KHR);
        let colour = vk::ImageAspectFlags::COLOR;
        let corner = |width: u32, height: u32| vk::Offset3D { x: width as i32, y: height as i32, z: 1 };
        let region = vk::ImageBlit::default()
            .src_subresource(layers(colour))
            .src_offsets([vk::Offset3D::default(), corner(size.width(), size.height())])
            .dst_subresource(layers(colour))
            .dst_offsets([vk::Offset3D::default(), corner(extent.width, extent.height)]);
        // After the semaphore, which is waited for in the stage of transfers.
        let acquired = (scope::FILL.0, vk::AccessFlags2::NONE);
        self.transition(shown, colour, (acquired, vk::ImageLayout::UNDEFINED), (scope::FILL, written));
        // SAFETY: the module's rule; the window's image was acquired, is a colour image of this size that
        // takes transfers, and the layouts are those that the barriers name. Both formats are ones that
        // Vulkan requires to be blitted, the picture's with a linear filter.
        unsafe {
            self.device.cmd_blit_image(
                self.commands,
                image.handle(),
                ImageUse::CopySource.layout(),
                shown,
                written,
                &[region],
                vk::Filter::LINEAR,
            );
        }
        // Presentation waits for a semaphore that makes the image available.
        self.transition(shown, colour, (scope::FILL, written), (scope::NOTHING, present));
    }

    /// Copies a whole image to the start of a buffer, tightly packed, top row first.
    pub(crate) fn copy_image(&self, image: &mut Image, size: Viewport, buffer: &Buffer) {
        self.hand_over(image, ImageUse::CopySource, false);
        let region = vk::BufferImageCopy::default()
            .image_subresource(layers(image.aspect()))
            .image_extent(vk::Extent3D { width: size.width(), height: size.height(), depth: 1 });
        // SAFETY: the module's rule; the image is in the layout named and the buffer holds all its texels.
        unsafe {
            self.device.cmd_copy_image_to_buffer(
                self.commands,
                image.handle(),
                ImageUse::CopySource.layout(),
                buffer.handle(),
                &[region],
            );
        }
    }

    /// Sets all words of a buffer.
    pub(crate) fn fill(&self, buffer: &Buffer, word: u32) {
        // SAFETY: the module's rule; the buffer was made to be written by transfers, and its size is a
        // multiple of 4.
        unsafe { self.device.cmd_fill_buffer(self.commands, buffer.handle(), 0, vk::WHOLE_SIZE, word) };
    }

    /// Copies the first elements of a host's buffer.
    pub(crate) fn copy_first<T: bytemuck::Pod>(&self, from: &HostBuffer<T>, to: &Buffer, count: usize) {
        let size = (count * size_of::<T>()) as u64;
        self.copy(from.buffer(), to, &[vk::BufferCopy { src_offset: 0, dst_offset: 0, size }]);
    }

    /// Copies ranges of bytes from one buffer to another.
    pub(crate) fn copy(&self, from: &Buffer, to: &Buffer, regions: &[vk::BufferCopy]) {
        // SAFETY: the module's rule; callers pass some ranges, inside both buffers, of which those written do
        // not overlap.
        unsafe { self.device.cmd_copy_buffer(self.commands, from.handle(), to.handle(), regions) };
    }

    /// Orders all memory accesses of the first scope before those of the second.
    pub(crate) fn barrier(&self, from: Scope, to: Scope) {
        let barriers = [vk::MemoryBarrier2::default()
            .src_stage_mask(from.0)
            .src_access_mask(from.1)
            .dst_stage_mask(to.0)
            .dst_access_mask(to.1)];
        let info = vk::DependencyInfo::default().memory_barriers(&barriers);
        // SAFETY: the module's rule; synchronization2 is enabled and no render pass is open.
        unsafe { self.device.cmd_pipeline_barrier2(self.commands, &info) };
    }

    /// Orders an image's next use after its last, with a transition to the next layout. With `discard` its
    /// content may be lost.
    fn hand_over(&self, image: &mut Image, next: ImageUse, discard: bool) {
        let from = image.last_use.map_or(scope::NOTHING, ImageUse::scope);
        let from_layout = match image.last_use {
            Some(last) if !discard => last.layout(),
            _ => vk::ImageLayout::UNDEFINED,
        };
        let to = (next.scope(), next.layout());
        self.transition(image.handle(), image.aspect(), (from, from_layout), to);
        image.last_use = Some(next);
    }

    /// Orders all of an image's uses of the first scope before those of the second, and changes its layout
    /// from the one that it has (or UNDEFINED, where its content may be lost).
    fn transition(
        &self,
        image: vk::Image,
        aspect: vk::ImageAspectFlags,
        (from, old): (Scope, vk::ImageLayout),
        (to, new): (Scope, vk::ImageLayout),
    ) {
        let barriers = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(from.0)
            .src_access_mask(from.1)
            .dst_stage_mask(to.0)
            .dst_access_mask(to.1)
            .old_layout(old)
            .new_layout(new)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image)
            .subresource_range(whole(aspect))];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the module's rule; the old layout is the one the image was left in, or UNDEFINED; no render
        // pass is open.
        unsafe { self.device.cmd_pipeline_barrier2(self.commands, &info) };
    }
}
