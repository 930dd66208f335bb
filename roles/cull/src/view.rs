//! A camera, its picture's size, and its sections.

use glam::{DMat3, DQuat, DVec3, DVec4, Mat4, Vec4};
use trimaran_proto::{Camera, Sections, ViewState};

use crate::{SubPixelGrid, Viewport};

/// A camera with a picture of a given size: the one definition of every transform from world to pixel. All
/// roles use it, so that OR, HC and RVG compute the same positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    camera: Camera,
    viewport: Viewport,
    to_view: DMat3,
    sections: Sections,
    grid: SubPixelGrid,
}

impl View {
    /// `camera` with a picture of `viewport`'s size, without sections, on the usual grid.
    #[must_use]
    pub fn new(camera: Camera, viewport: Viewport) -> Self {
        // A camera's quaternion has unit length to 1e-6; after normalization, lengths in view space equal
        // those in the world to 1e-15.
        let orientation = DQuat::from_array(camera.orientation()).normalize();
        let to_view = DMat3::from_quat(orientation).transpose();
        Self { camera, viewport, to_view, sections: Sections::NONE, grid: SubPixelGrid::default() }
    }

    /// `camera` with the view state that it names.
    #[must_use]
    pub fn of(camera: Camera, state: &ViewState) -> Self {
        Self::new(camera, state.viewport).with_sections(state.sections)
    }

    /// The same with these sections.
    #[must_use]
    pub const fn with_sections(self, sections: Sections) -> Self {
        Self { sections, ..self }
    }

    /// The same, drawn by a rasterizer of this grid.
    #[must_use]
    pub const fn on_grid(self, grid: SubPixelGrid) -> Self {
        Self { grid, ..self }
    }

    /// The rasterizer's grid.
    #[must_use]
    pub const fn grid(&self) -> SubPixelGrid {
        self.grid
    }

    /// The sections.
    #[must_use]
    pub const fn sections(&self) -> &Sections {
        &self.sections
    }

    /// The at most 36 planes that bound the kept part of sections, in view space: a point `p` is kept if `xyz
    /// . p + w` is at least 0 for each of them. Metres.
    pub fn section_planes(&self) -> impl Iterator<Item = DVec4> + '_ {
        self.sections.planes().map(|plane| {
            let direction = DVec3::from_array(plane.direction());
            let offset = (DVec3::from_array(plane.location()) - self.eye()).dot(direction);
            (-(self.to_view * direction)).extend(offset)
        })
    }

    /// The camera.
    #[must_use]
    pub const fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The picture's size.
    #[must_use]
    pub const fn viewport(&self) -> Viewport {
        self.viewport
    }

    /// The eye in world space, metres.
    #[must_use]
    pub const fn eye(&self) -> DVec3 {
        DVec3::from_array(self.camera.eye())
    }

    /// The rotation from world directions to view directions.
    #[must_use]
    pub const fn to_view(&self) -> DMat3 {
        self.to_view
    }

    /// A world point in view space (x right, y up, looking down -z, metres about the eye).
    #[must_use]
    pub fn world_to_view(&self, point: DVec3) -> DVec3 {
        self.to_view * (point - self.eye())
    }

    /// Pixels per radian near the axis, vertically: height / (2 tan(fov / 2)).
    #[must_use]
    pub fn focal_y(&self) -> f64 {
        f64::from(self.viewport.height()) / (2.0 * self.tan_half_fov_y())
    }

    /// Pixels per radian near the axis, horizontally.
    #[must_use]
    pub fn focal_x(&self) -> f64 {
        f64::from(self.viewport.width()) / (2.0 * self.tan_half_fov_x())
    }

    /// The tangent of half the vertical field of view.
    #[must_use]
    pub fn tan_half_fov_y(&self) -> f64 {
        f64::from(self.camera.tan_half_fov_y())
    }

    /// The tangent of half the horizontal field of view.
    #[must_use]
    pub fn tan_half_fov_x(&self) -> f64 {
        self.tan_half_fov_y() * f64::from(self.viewport.aspect())
    }

    /// View space to Vulkan clip space: reversed z, infinite far plane (depth = near / distance), y down,
    /// pixel (0, 0) at the top left.
    #[must_use]
    pub fn projection(&self) -> Mat4 {
        let tan_y = self.camera.tan_half_fov_y();
        let tan_x = tan_y * self.viewport.aspect();
        Mat4::from_cols(
            Vec4::new(1.0 / tan_x, 0.0, 0.0, 0.0),
            Vec4::new(0.0, -1.0 / tan_y, 0.0, 0.0),
            Vec4::new(0.0, 0.0, 0.0, -1.0),
            Vec4::new(0.0, 0.0, self.camera.near(), 0.0),
        )
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_1_SQRT_2;

    use trimaran_proto::{FrameNumber, Section, SectionPlane};

    use super::*;

    /// From (1, 2, 3) down -x, so that -z is to the right.
    fn view() -> View {
        let orientation = [0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2];
        let camera = Camera::new([1.0, 2.0, 3.0], orientation, 0.5, 0.1, FrameNumber(0)).unwrap();
        View::new(camera, Viewport::new(16, 8).unwrap())
    }

    #[test]
    fn view_space_is_right_up_and_back_from_the_eye() {
        let place = view().world_to_view(DVec3::new(-4.0, 3.0, 1.0));
        assert!(place.abs_diff_eq(DVec3::new(2.0, 1.0, -5.0), 1e-14), "{place}");
        assert_eq!([view().tan_half_fov_x(), view().tan_half_fov_y()], [1.0, 0.5]);
        assert_eq!(view().on_grid(SubPixelGrid::of_bits(4)).grid(), SubPixelGrid::of_bits(4));
    }

    #[test]
    fn clip_space_is_right_and_down_with_the_depth_as_w_and_the_near_plane_as_z() {
        let upright = View::new(*view().camera(), Viewport::new(8, 16).unwrap());
        let place = upright.projection() * Vec4::new(0.25, 1.0, -2.0, 1.0);
        assert_eq!(place, Vec4::new(1.0, -2.0, 0.1, 2.0));
    }

    #[test]
    fn planes_of_sections_keep_in_view_space_what_they_keep_in_the_world() {
        // All with x up to -2 is kept: from 3 m before the eye on.
        let plane = SectionPlane::new([-2.0, 7.0, 8.0], [1.0, 0.0, 0.0]).unwrap();
        let view = view().with_sections(Sections::new(&[Section::Plane(plane)]).unwrap());
        let planes: Vec<DVec4> = view.section_planes().collect();
        let [plane] = planes[..] else { panic!("{planes:?}") };
        assert!(plane.abs_diff_eq(DVec4::new(0.0, 0.0, -1.0, -3.0), 1e-14), "{plane}");
    }
}
