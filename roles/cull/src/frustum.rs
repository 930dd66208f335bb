//! The visible part of space: the view frustum without the parts that sections cut away.

use glam::{DMat3, DVec3};
use trimaran_proto::{DrawableId, Section, Sections};
use trimaran_scene::{Node, Scene};

use crate::View;

/// Slack of the frustum test: rounding here, in the vertex stage and in the rasterizer stays well below it.
pub(crate) const RELATIVE_SLACK: f64 = 1e-6;

/// The view frustum: four sides through the eye, the near plane, and sections.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frustum {
    eye: DVec3,
    to_view: DMat3,
    tan_x: f64,
    tan_y: f64,
    near: f64,
    sections: Sections,
}

impl Frustum {
    pub(crate) fn new(view: &View) -> Self {
        Self {
            eye: view.eye(),
            to_view: view.to_view(),
            tan_x: view.tan_half_fov_x(),
            tan_y: view.tan_half_fov_y(),
            near: f64::from(view.camera().near()),
            sections: *view.sections(),
        }
    }

    /// Whether a node's world box is certainly outside, or cut away. NaN counts as inside.
    ///
    /// Tested against planes one by one, so a large box near a corner of the frustum may pass though it is
    /// outside.
    pub(crate) fn excludes_world_box(&self, node: &Node) -> bool {
        let (min, max) = node.world_box();
        let half = (max - min) * 0.5;
        let offset = (min + max) * 0.5 - self.eye;
        let centre = self.to_view * offset;
        let axes = [self.to_view.x_axis * half.x, self.to_view.y_axis * half.y, self.to_view.z_axis * half.z];
        let origin = DVec3::from_array(node.origin) - self.eye;
        let slack = RELATIVE_SLACK * (l1(offset) + l1(half) + l1(origin));
        self.excludes(centre, &axes, slack) || self.cuts_away(min, max, slack)
    }

    /// Whether sections cut away the box with world corners `min` and `max`, grown by `slack` metres.
    fn cuts_away(&self, min: DVec3, max: DVec3, slack: f64) -> bool {
        self.sections.iter().any(|section| match section {
            Section::Plane(plane) => {
                let direction = DVec3::from_array(plane.direction());
                // The corner farthest back.
                let nearest = DVec3::select(direction.cmpgt(DVec3::ZERO), min, max);
                (nearest - DVec3::from_array(plane.location())).dot(direction) > slack
            }
            Section::Box(kept) => {
                let (low, high) = (DVec3::from_array(kept.min()), DVec3::from_array(kept.max()));
                ((min - high).cmpgt(DVec3::splat(slack)) | (low - max).cmpgt(DVec3::splat(slack))).any()
            }
        })
    }

    /// Whether the box of view-space `centre` and half-edges `axes`, grown by `slack` metres, is certainly
    /// outside.
    pub(crate) fn excludes(&self, centre: DVec3, axes: &[DVec3; 3], slack: f64) -> bool {
        // A side plane through the eye: t z' - s x >= 0 inside, with z' = -z the depth; `sum` is that form's
        // reach over the box.
        let beyond_side = |tan: f64, across: f64, along: f64, reach: [f64; 3], depth_reach: [f64; 3]| {
            let (mut right, mut left) = (0.0, 0.0);
            for (a, d) in reach.iter().zip(depth_reach) {
                right += (tan * d - a).abs();
                left += (tan * d + a).abs();
            }
            let grown = slack * (1.0 + tan);
            tan * along - across + right + grown < 0.0 || tan * along + across + left + grown < 0.0
        };
        let depth = -centre.z;
        let depths = axes.map(|axis| -axis.z);
        let thickness: f64 = depths.iter().map(|d| d.abs()).sum();
        depth + thickness + slack < self.near
            || beyond_side(self.tan_x, centre.x, depth, axes.map(|axis| axis.x), depths)
            || beyond_side(self.tan_y, centre.y, depth, axes.map(|axis| axis.y), depths)
    }
}

/// Removes drawables outside `view`, and none that it shows. Some outside may stay.
pub fn retain_in_sight(scene: &Scene, view: &View, ids: &mut Vec<DrawableId>) {
    let frustum = Frustum::new(view);
    ids.retain(|id| scene.part(*id).is_none_or(|(_, part)| !frustum.excludes_world_box(&part)));
}

fn l1(v: DVec3) -> f64 {
    v.x.abs() + v.y.abs() + v.z.abs()
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{Camera, FrameNumber, SectionBox, SectionPlane};

    use super::*;
    use crate::Viewport;

    /// Down -z from the eye, twice as wide as high: 45 degrees to each side. Near distance 0.25 m.
    fn frustum(eye: [f64; 3], section: Option<Section>) -> Frustum {
        let camera = Camera::new(eye, [0.0, 0.0, 0.0, 1.0], 0.5, 0.25, FrameNumber(0)).unwrap();
        let view = View::new(camera, Viewport::new(16, 8).unwrap());
        Frustum::new(&view.with_sections(Sections::new(section.as_slice()).unwrap()))
    }

    fn plane(location: DVec3, direction: DVec3) -> Section {
        Section::Plane(SectionPlane::new(location.to_array(), direction.to_array()).unwrap())
    }

    #[test]
    fn a_box_that_touches_a_side_of_the_frustum_with_its_slack_is_not_outside() {
        let frustum = frustum([0.0; 3], None);
        let axes = DVec3::AXES.map(|axis| axis * 0.5);
        // Half-edges of 0.5 m and a slack of 0.25 m: 0.75 m each way. The far corners touch, 4.75 m deep.
        // There the frustum reaches 4.75 m to the right and half as far up.
        for (touching, beyond) in [
            (DVec3::new(5.5, 0.0, -4.0), DVec3::X),
            (DVec3::new(-5.5, 0.0, -4.0), -DVec3::X),
            (DVec3::new(0.0, 3.125, -4.0), DVec3::Y),
            (DVec3::new(0.0, -3.125, -4.0), -DVec3::Y),
            (DVec3::new(0.0, 0.0, 0.5), DVec3::Z),
        ] {
            let outside = [0.0, 1e-9].map(|by| frustum.excludes(touching + beyond * by, &axes, 0.25));
            assert_eq!(outside, [false, true], "{touching}");
        }
    }

    #[test]
    fn sections_cut_away_what_is_beyond_them_by_more_than_the_slack() {
        let (min, max) = (DVec3::splat(5.0), DVec3::splat(6.0));
        let cuts = |section| frustum([0.0; 3], Some(section)).cuts_away(min, max, 0.25);
        let kept =
            |low: DVec3, high: DVec3| Section::Box(SectionBox::new(low.to_array(), high.to_array()).unwrap());
        let (low, high) = (DVec3::splat(4.0), DVec3::splat(8.0));
        assert!(!cuts(kept(low, high)));
        for axis in DVec3::AXES {
            let at = |corner: DVec3, place: f64| DVec3::select(axis.cmpgt(DVec3::ZERO), axis * place, corner);
            for (below, above, cut) in [(4.75, 6.25, false), (4.5, 6.5, true)] {
                let sections = [
                    plane(axis * below, axis),
                    plane(axis * above, -axis),
                    kept(low, at(high, below)),
                    kept(at(low, above), high),
                ];
                assert_eq!(sections.map(cuts), [cut; 4], "{axis} {below} {above}");
            }
        }
    }

    #[test]
    fn the_slack_is_a_millionth_of_the_numbers_that_place_a_box() {
        let eye = DVec3::new(10.0, 20.0, 30.0);
        let (centre, half) = (eye + DVec3::new(-1.0, 2.0, -8.0), DVec3::new(0.5, 3.0, 1.5));
        let (world_min, world_max) = ((centre - half).to_array(), (centre + half).to_array());
        let origin = (eye + DVec3::new(7.0, -16.0, -40.0)).to_array();
        let node = Node { world_min, world_max, origin, ..Node::default() };
        // About the eye: 11 m for the centre and 63 m for the origin, and 5 m of half-edges.
        let outside = [78e-6, 80e-6].map(|beyond| {
            let section = plane(DVec3::X * (world_min[0] - beyond), DVec3::X);
            frustum(eye.to_array(), Some(section)).excludes_world_box(&node)
        });
        assert_eq!(outside, [false, true]);
    }
}
