//! The surface of a missing drawable, by the f64 rasterizer.

use std::collections::BTreeMap;

use glam::DVec3;
use trimaran_cull::View;
use trimaran_scene::Scene;

use super::Missing;
use crate::id_buffer::{Placement, triangles, unproject};
use crate::raster::rasterize_triangle;

/// A pixel's centre may be covered by a surface that ends this far beside it: corners move by the sub-pixel
/// step.
const SNAP_PX: f64 = 1.0 / 256.0;

/// A point of a missing surface, at the centre of a pixel that it owns.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfacePoint {
    pub(super) pixel: usize,
    /// In view space, metres.
    pub(super) place: DVec3,
    /// Reversed depth.
    pub(super) depth: f64,
    /// The relative tolerance of this surface's depths between passes.
    pub(super) tolerance: f64,
}

impl SurfacePoint {
    /// The largest distance of this point from the surface, metres.
    pub(super) fn leeway(&self, view: &View) -> f64 {
        let focal = view.focal_x().min(view.focal_y());
        -self.place.z * (SNAP_PX / focal + self.tolerance)
    }
}

/// The missing surface at its pixels, by the f64 rasterizer. Pixels on its very edge may be absent. `slack`
/// is how far its node's box is inflated, metres.
pub(super) fn surface_of(missing: &Missing, scene: &Scene, view: &View, slack: f64) -> Vec<SurfacePoint> {
    let Some(drawable) = scene.drawables().get(missing.id.index()) else { return Vec::new() };
    let mut nearest: BTreeMap<usize, Option<SurfacePoint>> =
        missing.pixels.iter().map(|&pixel| (pixel, None)).collect();
    for corners in triangles(scene, view, drawable, Placement::Exact) {
        let snap = depth_of_a_snap(view, &corners);
        rasterize_triangle(view, corners, |hit| {
            let Some(found) = nearest.get_mut(&hit.pixel) else { return };
            if found.is_none_or(|found| hit.depth > found.depth) {
                let place = unproject(view, hit.pixel, hit.depth);
                // Each of two passes may be off by the slack, and by a step of the sub-pixel grid where
                // the surface is steep.
                let tolerance = 2.0 * slack / -place.z + snap / hit.depth;
                *found = Some(SurfacePoint { pixel: hit.pixel, place, depth: hit.depth, tolerance });
            }
        });
    }
    nearest.into_values().flatten().collect()
}

/// The change of a triangle's reversed depth over a step of the sub-pixel grid, right and down together.
fn depth_of_a_snap(view: &View, [a, b, c]: &[DVec3; 3]) -> f64 {
    let normal = (*b - *a).cross(*c - *a);
    // Reversed depth is near / distance, which on the plane `normal . p = offset` is linear on the screen.
    let scale = f64::from(view.camera().near()) / normal.dot(*a);
    let gradient = ((normal.x / view.focal_x()).abs() + (normal.y / view.focal_y()).abs()) * scale.abs();
    // A plane through the eye is edge-on: its depth is undefined.
    if gradient.is_finite() { SNAP_PX * gradient } else { 0.0 }
}
