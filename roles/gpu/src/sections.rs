//! What the shaders know of the sections.

use trimaran_cull::View;
use trimaran_proto::Sections;

/// `Sections` of scene.wgsl.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct SectionPlanes {
    count: u32,
    padding: [u32; 3],
    /// At most six a section: a box has as many.
    planes: [[[f32; 4]; 6]; Sections::MOST],
}

/// Farther than anything, metres; finite in f32 whatever the shaders multiply it by.
const FARTHEST: f64 = 1e30;

impl SectionPlanes {
    /// The planes of a view, worked out in f64 and rounded once.
    pub(crate) fn new(view: &View) -> Self {
        let near = f64::from(view.camera().near());
        let mut sections = Self { count: 0, padding: [0; 3], planes: Default::default() };
        for (slot, plane) in sections.planes.as_flattened_mut().iter_mut().zip(view.section_planes()) {
            let offset = plane.w.clamp(-FARTHEST, FARTHEST);
            *slot = (plane.truncate() * near).extend(offset).as_vec4().to_array();
            sections.count += 1;
        }
        sections
    }
}
