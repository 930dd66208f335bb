//! The shaders' section data.

use trimaran_cull::View;
use trimaran_proto::Sections;

/// `Sections` of scene.wgsl.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct SectionPlanes {
    count: u32,
    padding: [u32; 3],
    /// At most six per section: those of a box.
    planes: [[[f32; 4]; 6]; Sections::MOST],
}

/// Farther than anything, metres; stays finite in the shaders' f32 products.
const FARTHEST: f64 = 1e30;

impl SectionPlanes {
    /// The planes of a view, computed in f64 and rounded once.
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

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_proto::{Section, SectionBox, SectionPlane};

    use super::*;
    use crate::common::view;

    #[test]
    fn there_is_room_for_six_boxes_and_every_number_is_finite() {
        let view = view(8, 8, DVec3::ZERO);
        let far = Section::Plane(SectionPlane::new([-1e300, 0.0, 0.0], [1.0, 0.0, 0.0]).unwrap());
        let all = Section::Box(SectionBox::new([-1e300; 3], [1e300; 3]).unwrap());
        for (section, count) in [(far, 6), (all, 36)] {
            let view = view.with_sections(Sections::new(&[section; Sections::MOST]).unwrap());
            let sections = SectionPlanes::new(&view);
            assert_eq!(sections.count, count);
            // Shaders need not handle infinity.
            assert!(sections.planes.as_flattened().as_flattened().iter().all(|number| number.is_finite()));
        }
    }
}
