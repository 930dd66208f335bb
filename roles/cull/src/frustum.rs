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
