//! The shaders' camera data.

use glam::{DVec3, Vec3};
use trimaran_cull::View;

/// `Camera` of scene.wgsl, as push constants.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct CameraConstants {
    projection: ProjectionConstants,
    ray_scale: [f32; 2],
    ray_offset: [f32; 2],
    key: [f32; 4],
    up: [f32; 4],
}

/// `Camera` of boxes.wgsl, and the head of that of scene.wgsl.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct ProjectionConstants {
    scale: [f32; 2],
    near: f32,
    padding: f32,
}

/// Direction of the key light, in the world: from above, from the side, a little from the front. No two walls
/// of a right-angled building face it alike.
const KEY: DVec3 = DVec3::new(0.48, 0.80, 0.36);

impl CameraConstants {
    pub(crate) fn new(view: &View) -> Self {
        let (tan_x, tan_y) = (view.tan_half_fov_x(), view.tan_half_fov_y());
        let (width, height) = (f64::from(view.viewport().width()), f64::from(view.viewport().height()));
        let direction = |world: DVec3| {
            let Vec3 { x, y, z } = (view.to_view() * world.normalize()).as_vec3();
            [x, y, z, 0.0]
        };
        Self {
            projection: ProjectionConstants::new(view),
            ray_scale: [(2.0 * tan_x / width) as f32, (-2.0 * tan_y / height) as f32],
            ray_offset: [-tan_x as f32, tan_y as f32],
            key: direction(KEY),
            up: direction(DVec3::Y),
        }
    }
}

impl ProjectionConstants {
    /// The three numbers of [`View::projection`] that are not 0 or 1.
    pub(crate) fn new(view: &View) -> Self {
        let projection = view.projection();
        Self { scale: [projection.x_axis.x, projection.y_axis.y], near: projection.w_axis.z, padding: 0.0 }
    }
}
