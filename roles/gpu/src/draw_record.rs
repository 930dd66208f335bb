//! One draw in the device's layout.

use trimaran_scene::Drawable;

use crate::place::Place;

/// How the vertices of a draw are fetched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fetch {
    /// By the pipeline, through the index buffer.
    Fixed,
    /// By the vertex shader, from storage buffers: it then knows the number of its triangle.
    Pulled,
}

/// The shaders' data of a draw: `Draw` of scene.wgsl, and further data for the item pass (ID buffer).
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

/// `VkDrawIndexedIndirectCommand`, or a `VkDrawIndirectCommand` with an unused word behind it.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct DrawCommand([u32; 5]);

impl DrawCommand {
    /// One instance, with the number `instance`, of a drawable whose triangles are at `place`.
    pub(crate) const fn new(fetch: Fetch, drawable: &Drawable, place: Place, instance: u32) -> Self {
        let (indices, Place { first_index, first_vertex }) = (3 * drawable.triangles, place);
        Self(match fetch {
            // The offset is signed, and arenas are small enough for that.
            Fetch::Fixed => [indices, 1, first_index, first_vertex, instance],
            // The number of a vertex is its position among the indices.
            Fetch::Pulled => [indices, 1, first_index, instance, 0],
        })
    }
}
