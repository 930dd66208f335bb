//! One draw as the device reads it.

use trimaran_scene::Drawable;

/// How the vertices of a draw are fetched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fetch {
    /// By the pipeline, by way of the index buffer.
    Fixed,
    /// By the vertex shader, from storage buffers: it then knows which triangle it works on.
    Pulled,
}

/// What the shaders know of a draw: `Draw` of scene.wgsl, and what the item pass reads beside it.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct DrawRecord {
    /// Local frame to view space: the rows of a 3x4 matrix.
    pub(crate) to_view: [[f32; 4]; 3],
    /// The drawable.
    pub(crate) id: u32,
    /// Its first index and its first vertex.
    pub(crate) first: [u32; 2],
}

/// `VkDrawIndexedIndirectCommand`, or a `VkDrawIndirectCommand` with a word behind it that is not read.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct DrawCommand([u32; 5]);

impl DrawCommand {
    /// One instance, that of the number `instance`, of a drawable.
    pub(crate) const fn new(fetch: Fetch, drawable: &Drawable, instance: u32) -> Self {
        let Drawable { index_count, first_index, vertex_offset, .. } = *drawable;
        Self(match fetch {
            // The offset is signed; `GpuScene::upload` has seen that it fits.
            Fetch::Fixed => [index_count, 1, first_index, vertex_offset, instance],
            // The number of a vertex is its place among the indices.
            Fetch::Pulled => [index_count, 1, first_index, instance, 0],
        })
    }
}
