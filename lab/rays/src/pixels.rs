//! The rays of a view: one through the centre of each pixel.

use glam::{DMat3, DVec2, DVec3, DVec4, Vec3A, Vec4};
use trimaran_cull::View;

use super::packet::Packet;

/// The rays of a view. They start at the eye. Their directions are in the world, scaled so that distances
/// along them are depths in metres.
pub(crate) struct PixelRays {
    middle: DVec2,
    focal: DVec2,
    to_world: DMat3,
    near: f64,
    /// The planes of sections, in view space.
    planes: Vec<DVec4>,
}

/// Farther than anything, metres: the end of rays without a section.
const FARTHEST: f64 = 1e30;

impl PixelRays {
    pub(crate) fn new(view: &View) -> Self {
        let size = DVec2::new(f64::from(view.viewport().width()), f64::from(view.viewport().height()));
        Self {
            middle: size * 0.5,
            focal: DVec2::new(view.focal_x(), -view.focal_y()),
            to_world: view.to_view().transpose(),
            near: f64::from(view.camera().near()),
            planes: view.section_planes().collect(),
        }
    }

    /// The rays of four pixels: this one, and those to the right, below and both. And the end of each ray.
    pub(crate) fn packet(&self, column: usize, row: usize) -> (Packet, Vec4) {
        let directions = [(0.5, 0.5), (1.5, 0.5), (0.5, 1.5), (1.5, 1.5)].map(|centre| {
            let centre = DVec2::from(centre) + DVec2::new(column as f64, row as f64);
            ((centre - self.middle) / self.focal).extend(-1.0)
        });
        let kept = directions.map(|direction| self.kept(direction));
        let begin = Vec4::from_array(kept.map(|(begin, _)| begin as f32));
        let end = Vec4::from_array(kept.map(|(_, end)| end as f32));
        let directions = directions.map(|direction| (self.to_world * direction).as_vec3a());
        (Packet::new(Vec3A::ZERO, directions, begin), end)
    }

    /// The valid interval of a ray: beyond the near plane, and kept by all planes. Empty if it ends before it
    /// begins.
    fn kept(&self, direction: DVec3) -> (f64, f64) {
        let (mut begin, mut end) = (self.near, FARTHEST);
        for plane in &self.planes {
            let slope = plane.truncate().dot(direction);
            let crosses = -plane.w / slope;
            if slope > 0.0 {
                begin = begin.max(crosses);
            } else if slope < 0.0 {
                end = end.min(crosses);
            } else if plane.w < 0.0 {
                end = -1.0;
            }
        }
        (begin, end)
    }
}
