//! The screen distance of pixels from surfaces.
//!
//! Two pictures of the same object can be compared pixel by pixel only if both hit it. A part thinner than a
//! pixel may hit a pixel's centre in one and none in the other, and the neighbours at the border of one may
//! lie outside the other. So the distance is not taken to the other picture's pixels but to its *surfaces*,
//! projected in f64, even if they miss all samples, are hidden, or lie outside of the picture.

use glam::{DVec2, DVec3};
use trimaran_cull::View;
use trimaran_proto::DrawableId;
use trimaran_scene::{Node, Scene};

use crate::grid::{Grid, bounds};
use crate::id_buffer::{Placement, triangles};
use crate::raster::clip;

/// The first search radius. It suffices for most pixels; for the others it is repeatedly multiplied by four.
const FIRST_REACH_PX: f64 = 1.0;

/// For each of `pixels` (indices into `view`'s picture, row by row from the top left) the distance on the
/// screen, in pixels, from its centre to the nearest surface of `ids`: 0 where a surface covers it. A surface
/// counts wherever it lies beyond the near plane, inside the picture or outside, hidden or not. `None` if
/// there is none within the picture's diagonal.
#[must_use]
pub fn distances_to_surfaces(
    scene: &Scene,
    view: &View,
    pixels: &[usize],
    ids: &[DrawableId],
) -> Vec<Option<f64>> {
    let (width, height) = (view.viewport().width() as usize, f64::from(view.viewport().height()));
    let centres: Vec<DVec2> =
        pixels.iter().map(|p| DVec2::new((p % width) as f64 + 0.5, (p / width) as f64 + 0.5)).collect();
    let diagonal = (width as f64).hypot(height);
    let mut found = vec![None; pixels.len()];
    let mut open: Vec<usize> = (0..pixels.len()).collect();
    let mut reach = FIRST_REACH_PX;
    while !open.is_empty() {
        let mut search = Search::new(view, open.iter().map(|&p| centres[p]).collect(), reach.min(diagonal));
        for &id in ids {
            search.look_at(scene, view, id);
        }
        for (&pixel, &squared) in open.iter().zip(&search.squared) {
            found[pixel] = squared.is_finite().then(|| squared.sqrt());
        }
        open.retain(|&pixel| found[pixel].is_none());
        if reach >= diagonal {
            break;
        }
        reach *= 4.0;
    }
    found
}

/// Screen points with the nearest surface within reach.
struct Search {
    points: Vec<DVec2>,
    /// Squared distance of each point to the nearest surface so far; infinite while nothing is within reach.
    squared: Vec<f64>,
    reach: f64,
    grid: Grid,
    focal: DVec2,
    middle: DVec2,
    near: f64,
}

impl Search {
    fn new(view: &View, points: Vec<DVec2>, reach: f64) -> Self {
        let size = DVec2::new(f64::from(view.viewport().width()), f64::from(view.viewport().height()));
        Self {
            squared: vec![f64::INFINITY; points.len()],
            grid: Grid::new(&points, reach),
            points,
            reach,
            focal: DVec2::new(view.focal_x(), view.focal_y()),
            middle: size * 0.5,
            near: f64::from(view.camera().near()),
        }
    }

    /// Takes a drawable's surfaces into account.
    fn look_at(&mut self, scene: &Scene, view: &View, id: DrawableId) {
        let Some((drawable, part)) = scene.part(id) else { return };
        if self.certainly_far(view, &part) {
            return;
        }
        for corners in triangles(scene, view, drawable, Placement::Exact) {
            if !corners.iter().all(|corner| corner.is_finite()) {
                continue;
            }
            if corners.iter().all(|corner| -corner.z >= self.near) {
                self.measure(&corners.map(|corner| self.project(corner)));
            } else {
                let mut polygon = corners.to_vec();
                clip(&mut polygon, |p| -p.z - self.near);
                let on_screen: Vec<DVec2> = polygon.into_iter().map(|corner| self.project(corner)).collect();
                self.measure(&on_screen);
            }
        }
    }

    /// Whether no point is within reach of the node's box.
    fn certainly_far(&self, view: &View, node: &Node) -> bool {
        let (min, max) = node.world_box();
        let corners: [DVec3; 8] = std::array::from_fn(|corner| {
            let side = |axis: usize| if corner >> axis & 1 == 0 { min[axis] } else { max[axis] };
            view.world_to_view(DVec3::new(side(0), side(1), side(2)))
        });
        if corners.iter().all(|corner| -corner.z < self.near) {
            return true;
        }
        // A box that reaches the near plane may be anywhere on the screen.
        if !corners.iter().all(|corner| corner.is_finite() && -corner.z >= self.near) {
            return false;
        }
        let (low, high) = bounds(&corners.map(|corner| self.project(corner)));
        !self.grid.holds_any(low - self.reach, high + self.reach)
    }

    fn project(&self, p: DVec3) -> DVec2 {
        self.middle + DVec2::new(p.x, -p.y) * self.focal / -p.z
    }

    /// Enters the distances of the points within reach of a convex polygon.
    fn measure(&mut self, polygon: &[DVec2]) {
        let (low, high) = bounds(polygon);
        let Self { points, squared, reach, grid, .. } = self;
        for &point in grid.cells(low - *reach, high + *reach).flatten() {
            let (at, nearest) = (points[point], &mut squared[point]);
            // The polygon's rectangle first: most points are too far even from that.
            if at.distance_squared(at.clamp(low, high)) < *nearest {
                let found = squared_distance(at, polygon, (low, high));
                if found <= *reach * *reach && found < *nearest {
                    *nearest = found;
                }
            }
        }
    }
}

/// The squared distance from a point to a convex polygon within the given bounds; 0 inside. The polygon may
/// be flat: then no point is inside.
fn squared_distance(point: DVec2, polygon: &[DVec2], (low, high): (DVec2, DVec2)) -> f64 {
    let within = point.cmpge(low).all() && point.cmple(high).all();
    let (mut left, mut right) = (within, within);
    let mut nearest = f64::INFINITY;
    for (&a, &b) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        let (edge, to_point) = (b - a, point - a);
        let side = edge.perp_dot(to_point);
        left &= side > 0.0;
        right &= side < 0.0;
        let along = if edge == DVec2::ZERO {
            0.0
        } else {
            (edge.dot(to_point) / edge.length_squared()).clamp(0.0, 1.0)
        };
        nearest = nearest.min(point.distance_squared(a + edge * along));
    }
    if left || right { 0.0 } else { nearest }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;
    use trimaran_cull::Viewport;
    use trimaran_scene::random::Random;

    use trimaran_cull::SURFACE_SLACK_PX;

    use super::*;
    use crate::cases::{Mesh, Object, build, looking};
    use crate::rasterize;

    /// At depth 10 a metre is a pixel, and the picture's middle is straight ahead (along y; z is up).
    fn view() -> View {
        looking(
            DVec3::ZERO,
            DVec3::Y,
            2.0 * f64::atan2(16.0, 10.0).to_degrees(),
            Viewport::new(32, 32).unwrap(),
            0,
        )
        .unwrap()
    }

    /// A rectangle from `low` to `high` (pixels, y down) at depth 10.
    fn rectangle(low: (f32, f32), high: (f32, f32)) -> Object {
        let middle = Vec3::new((low.0 + high.0) / 2.0 - 16.0, 10.0, 16.0 - (low.1 + high.1) / 2.0);
        let (a, b) = ((high.0 - low.0) / 2.0, (high.1 - low.1) / 2.0);
        Object::new(Mesh::rectangle(middle, Vec3::X * a, Vec3::Z * b, 1))
    }

    fn distances(objects: &[Object], pixels: &[usize]) -> Vec<Option<f64>> {
        let scene = build(objects, false).unwrap();
        let ids: Vec<DrawableId> = (0..scene.drawables().len() as u32).map(DrawableId).collect();
        distances_to_surfaces(&scene, &view(), pixels, &ids)
    }

    fn assert_near(found: Option<f64>, expected: f64) {
        assert!(found.is_some_and(|found| (found - expected).abs() < 1e-5), "{found:?}, not {expected}");
    }

    const fn pixel(x: usize, y: usize) -> usize {
        y * 32 + x
    }

    #[test]
    fn the_distance_is_to_the_edge_and_not_to_a_pixel_centre() {
        let found =
            distances(&[rectangle((4.0, 4.0), (10.25, 20.0))], &[pixel(12, 8), pixel(8, 8), pixel(10, 20)]);
        assert_near(found[0], 2.25);
        assert_near(found[1], 0.0);
        assert_near(found[2], 0.25_f64.hypot(0.5));
    }

    #[test]
    fn a_wire_between_the_pixel_centres_is_found() {
        let wire = rectangle((0.0, 7.6), (32.0, 7.61));
        let scene = build(std::slice::from_ref(&wire), false).unwrap();
        assert!(
            rasterize(&scene, &view(), [DrawableId(0)], Placement::Exact).seen().is_empty(),
            "no centre is hit"
        );
        let found = distances(&[wire], &[pixel(3, 7), pixel(3, 9)]);
        assert_near(found[0], 0.1);
        assert_near(found[1], 1.89);
    }

    #[test]
    fn a_partner_outside_of_the_picture_counts() {
        let found = distances(&[rectangle((-9.0, 4.0), (-1.5, 20.0))], &[pixel(0, 8)]);
        assert_near(found[0], 2.0);
    }

    #[test]
    fn what_is_hidden_counts() {
        // At half the depth twice as wide: up to column 32, the whole picture.
        let wall = rectangle((0.0, 0.0), (24.0, 32.0)).at(DVec3::Y * -5.0);
        let behind = rectangle((20.0, 6.0), (30.0, 12.0));
        let scene = build(&[wall, behind], false).unwrap();
        assert_eq!(rasterize(&scene, &view(), [0, 1].map(DrawableId), Placement::Exact).seen().len(), 1);
        let far = scene.drawables().iter().position(|d| scene.nodes()[d.node as usize].world_min[1] > 8.0);
        let hidden = DrawableId(far.unwrap() as u32);
        assert_near(distances_to_surfaces(&scene, &view(), &[pixel(31, 8)], &[hidden])[0], 1.5);
    }

    #[test]
    fn nothing_anywhere_is_no_distance() {
        let behind = rectangle((0.0, 0.0), (32.0, 32.0)).at(DVec3::Y * -30.0);
        assert_eq!(distances(&[behind], &[0, pixel(9, 9)]), [None, None]);
        let far_aside = rectangle((100.0, 0.0), (110.0, 32.0));
        assert_eq!(distances(&[far_aside], &[pixel(0, 9)]), [None], "farther than the picture's diagonal");
        let scene = build(&[rectangle((0.0, 0.0), (1.0, 1.0))], false).unwrap();
        assert_eq!(distances_to_surfaces(&scene, &view(), &[3], &[]), [None], "nothing was drawn");
        assert!(distances(&[rectangle((0.0, 0.0), (1.0, 1.0))], &[]).is_empty());
    }

    #[test]
    fn a_surface_through_the_near_plane_counts_beyond_it() {
        // A floor one metre below the eye, from behind it to far ahead: it shows below the horizon only.
        let floor = Object::new(Mesh::rectangle(Vec3::Z * -1.0, Vec3::X * 500.0, Vec3::Y * 500.0, 1));
        let found = distances(&[floor], &[pixel(16, 31), pixel(16, 10)]);
        assert_near(found[0], 0.0);
        // Its far edge is 500 m ahead and 1 m down: 0.02 pixels below the middle, 16.
        assert_near(found[1], 16.02 - 10.5);
    }

    #[test]
    fn a_flat_triangle_has_a_distance() {
        let mut line = rectangle((4.0, 8.5), (8.0, 8.5));
        line.mesh.positions.iter_mut().for_each(|p| p.z = 7.5);
        let found = distances(&[line], &[pixel(10, 8), pixel(5, 8), pixel(5, 12)]);
        assert_near(found[0], 2.5);
        assert_near(found[1], 0.0);
        assert_near(found[2], 4.0);
    }

    proptest! {
        /// Pixels that a rectangle covers, against the same rectangle shifted: none is farther than the
        /// shift, and where the shift is a whole number of pixels the farthest is as far.
        #[test]
        fn a_shift_by_d_is_at_most_d(
            low in (2.0..20.0_f32, 2.0..20.0_f32), size in (4.0..10.0_f32, 4.0..10.0_f32),
            shift in (-8.0..8.0_f32, -8.0..8.0_f32),
        ) {
            let shifted = |by: (f32, f32)| {
                let low = (low.0 + by.0, low.1 + by.1);
                rectangle(low, (low.0 + size.0, low.1 + size.1))
            };
            let scene = build(&[shifted((0.0, 0.0))], false).unwrap();
            let shown = rasterize(&scene, &view(), [DrawableId(0)], Placement::Exact);
            let covered: Vec<usize> = (0..1024).filter(|&p| shown.ids()[p].is_some()).collect();
            let largest = |shift: (f32, f32)| {
                let found = distances(&[shifted(shift)], &covered);
                found.into_iter().map(|d| d.unwrap_or(f64::INFINITY)).fold(0.0, f64::max)
            };
            let length = f64::from(shift.0).hypot(f64::from(shift.1));
            let found = largest(shift);
            prop_assert!(found <= length + SURFACE_SLACK_PX, "{} > {}", found, length);
            // The covered centre nearest to the edge left behind is less than a pixel off it, in each
            // direction.
            prop_assert!(found >= length - 2.0_f64.sqrt() - SURFACE_SLACK_PX, "{} < {}", found, length);
        }

        /// Against every triangle for every pixel, without a grid or a reach.
        #[test]
        fn agrees_with_brute_force(seed: u64) {
            let mut random = Random::new(seed);
            let objects: Vec<Object> = (0..12)
                .map(|_| {
                    let place = random.point(DVec3::new(-40.0, -10.0, -40.0), DVec3::new(40.0, 40.0, 40.0));
                    let half = random.point(DVec3::ZERO, DVec3::splat(3.0)).as_vec3();
                    Object::new(Mesh::cuboid(-half, half, 1)).at(place)
                })
                .collect();
            let scene = build(&objects, false).unwrap();
            let view = view();
            let ids: Vec<DrawableId> = (0..scene.drawables().len() as u32).map(DrawableId).collect();
            let pixels: Vec<usize> = (0..1024).step_by(37).collect();
            let near = f64::from(view.camera().near());
            let mut expected = vec![f64::INFINITY; pixels.len()];
            for drawable in scene.drawables() {
                for corners in triangles(&scene, &view, drawable, Placement::Exact) {
                    let mut polygon = corners.to_vec();
                    clip(&mut polygon, |p| -p.z - near);
                    let flat: Vec<DVec2> =
                        polygon.iter().map(|p| DVec2::splat(16.0) + DVec2::new(p.x, -p.y) * 10.0 / -p.z).collect();
                    for (best, pixel) in expected.iter_mut().zip(&pixels) {
                        let at = DVec2::new((pixel % 32) as f64 + 0.5, (pixel / 32) as f64 + 0.5);
                        *best = best.min(squared_distance(at, &flat, bounds(&flat)));
                    }
                }
            }
            let diagonal = 32.0 * 2.0_f64.sqrt();
            for (found, expected) in distances_to_surfaces(&scene, &view, &pixels, &ids).into_iter().zip(expected) {
                let expected = Some(expected.sqrt()).filter(|&d| d <= diagonal);
                prop_assert_eq!(found.is_some(), expected.is_some());
                if let (Some(found), Some(expected)) = (found, expected) {
                    prop_assert!((found - expected).abs() < 1e-3, "{} {}", found, expected);
                }
            }
        }
    }
}
