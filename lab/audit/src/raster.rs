//! Rasterizes one triangle, by the rules of the Vulkan specification (chapter "Rasterization").
//!
//! Corners snap to the grid of the view; a pixel is covered if its centre is inside by exact integer edge
//! functions, or on a top or left edge; both windings are drawn. Depth is near / distance, which is linear on
//! the screen, interpolated in f64.

use glam::{DVec2, DVec3};
use trimaran_cull::View;

/// The guard band: triangles are clipped this far from the picture's middle, in pixels, to keep the integers
/// small.
const GUARD_PX: f64 = 65536.0;

/// A pixel that a triangle covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coverage {
    /// Index of the pixel, row by row from the top left.
    pub pixel: usize,
    /// Reversed depth: near / distance.
    pub depth: f64,
}

/// Calls `cover` for each pixel that the triangle of view-space `corners` covers in `view`'s picture, in rows
/// from the top. Corners that are not finite cover nothing.
pub fn rasterize_triangle(view: &View, corners: [DVec3; 3], mut cover: impl FnMut(Coverage)) {
    if !corners.iter().all(|corner| corner.is_finite()) {
        return;
    }
    let near = f64::from(view.camera().near());
    let (fx, fy) = (view.focal_x(), view.focal_y());
    let middle = DVec2::new(f64::from(view.viewport().width()), f64::from(view.viewport().height())) * 0.5;
    let mut polygon: Vec<DVec3> = corners.to_vec();
    // The near plane, then the guard band: each plane is where a linear function of the point is at least 0.
    clip(&mut polygon, |p| -p.z - near);
    clip(&mut polygon, |p| -p.z * GUARD_PX - p.x * fx);
    clip(&mut polygon, |p| -p.z * GUARD_PX + p.x * fx);
    clip(&mut polygon, |p| -p.z * GUARD_PX - p.y * fy);
    clip(&mut polygon, |p| -p.z * GUARD_PX + p.y * fy);
    let steps = f64::from(view.grid().steps());
    let screen: Vec<Corner> = polygon
        .iter()
        .map(|p| {
            let inverse = -1.0 / p.z;
            let at = middle + DVec2::new(fx * p.x * inverse, -fy * p.y * inverse);
            let [x, y] = [at.x, at.y].map(|pixels| (pixels * steps).round_ties_even() as i64);
            Corner { x, y, depth: (near * inverse).min(1.0) }
        })
        .collect();
    let [first, rest @ ..] = screen.as_slice() else { return };
    for pair in rest.windows(2) {
        let [second, third] = pair else { continue };
        fill(view, [*first, *second, *third], &mut cover);
    }
}

/// A corner on the sub-pixel grid.
#[derive(Debug, Clone, Copy)]
struct Corner {
    x: i64,
    y: i64,
    depth: f64,
}

/// Keeps the part of a convex polygon where `side` is at least 0 (Sutherland and Hodgman, 1974).
pub(crate) fn clip(polygon: &mut Vec<DVec3>, side: impl Fn(DVec3) -> f64) {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (index, &here) in polygon.iter().enumerate() {
        let Some(&next) = polygon.get((index + 1) % polygon.len()) else { continue };
        let (a, b) = (side(here), side(next));
        if a >= 0.0 {
            kept.push(here);
        }
        if (a >= 0.0) != (b >= 0.0) {
            kept.push(here + (next - here) * (a / (a - b)));
        }
    }
    *polygon = kept;
}

/// Twice the signed area of a, b, p; positive on the inner side of the edges of a triangle that winds
/// clockwise on the screen (y points down).
fn edge(a: Corner, b: Corner, x: i64, y: i64) -> i64 {
    (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)
}

fn fill(view: &View, [a, mut b, mut c]: [Corner; 3], cover: &mut impl FnMut(Coverage)) {
    let mut area = edge(a, b, c.x, c.y);
    if area == 0 {
        return;
    }
    if area < 0 {
        (b, c) = (c, b);
        area = -area;
    }
    let (width, height) = (i64::from(view.viewport().width()), i64::from(view.viewport().height()));
    let step = i64::from(view.grid().steps());
    let pixel_range = |low: i64, high: i64, size: i64| {
        (low - step / 2).div_euclid(step).max(0)..=high.div_euclid(step).min(size - 1)
    };
    let columns = pixel_range(a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x), width);
    let rows = pixel_range(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y), height);
    // A centre on an edge belongs to the triangle only if the edge is a top or a left one: the others must be
    // cleared by 1.
    let owes = |from: Corner, to: Corner| {
        let top = from.y == to.y && to.x > from.x;
        let left = to.y < from.y;
        i64::from(!(top || left))
    };
    let (owes_a, owes_b, owes_c) = (owes(b, c), owes(c, a), owes(a, b));
    for row in rows {
        let y = row * step + step / 2;
        for column in columns.clone() {
            let x = column * step + step / 2;
            let (wa, wb, wc) = (edge(b, c, x, y), edge(c, a, x, y), edge(a, b, x, y));
            if wa >= owes_a && wb >= owes_b && wc >= owes_c {
                let depth = (wa as f64 * a.depth + wb as f64 * b.depth + wc as f64 * c.depth) / area as f64;
                cover(Coverage { pixel: (row * width + column) as usize, depth });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use trimaran_cull::Viewport;
    use trimaran_scene::random::Random;

    use super::*;
    use crate::cases::looking;

    fn view() -> View {
        looking(DVec3::ZERO, DVec3::Y, 90.0, Viewport::new(32, 32).unwrap(), 0).unwrap()
    }

    fn covered(corners: [DVec3; 3]) -> Vec<usize> {
        let mut pixels = Vec::new();
        rasterize_triangle(&view(), corners, |hit| pixels.push(hit.pixel));
        pixels
    }

    #[test]
    fn a_triangle_covers_the_pixels_whose_centres_it_holds() {
        // At depth 16 a metre is a pixel. The upper left half of the picture's middle 4 x 4 pixels: centres
        // on the diagonal are on its right edge, which is not its own.
        let corners =
            [DVec3::new(-2.0, 2.0, -16.0), DVec3::new(2.0, 2.0, -16.0), DVec3::new(-2.0, -2.0, -16.0)];
        let [first, second, third] = [14, 15, 16].map(|row| row * 32 + 14);
        let expected = [first, first + 1, first + 2, second, second + 1, third];
        assert_eq!(covered(corners), expected);
        let [a, b, c] = corners;
        assert_eq!(covered([a, c, b]), expected, "the other winding");
    }

    #[test]
    fn an_edge_shared_by_two_triangles_covers_each_pixel_once() {
        let mut random = Random::new(5);
        for _ in 0..300 {
            let mut corner = || random.point(DVec3::new(-9.0, -9.0, -20.0), DVec3::new(9.0, 9.0, -8.0));
            let (a, b) = (corner(), corner());
            let (mut c, mut d) = (corner(), corner());
            // On either side of the edge as seen from the eye.
            let side = |p: DVec3| a.cross(b).dot(p);
            if side(c) * side(d) > 0.0 {
                (c, d) = (c, (a + b) - c * 0.999);
            }
            if side(c) * side(d) >= 0.0 || d.z > -1.0 {
                continue;
            }
            let mut both = covered([a, b, c]);
            both.extend(covered([a, b, d]));
            let count = both.len();
            both.sort_unstable();
            both.dedup();
            assert_eq!(both.len(), count, "{a} {b} {c} {d}");
        }
    }

    #[test]
    fn what_is_nearer_than_the_near_plane_is_clipped() {
        let floor =
            [DVec3::new(-50.0, -1.0, 5.0), DVec3::new(50.0, -1.0, 5.0), DVec3::new(0.0, -1.0, -500.0)];
        let mut pixels = Vec::new();
        rasterize_triangle(&view(), floor, |hit| pixels.push(hit));
        assert!(pixels.len() > 400, "{}", pixels.len());
        assert!(pixels.iter().all(|hit| hit.pixel / 32 >= 16), "a floor is below the horizon");
        // Row 31's centre is 15.5 pixels down at 16 pixels a unit: the floor is 1 m / (15.5 / 16) away there.
        let lowest = pixels.iter().find(|hit| hit.pixel == 31 * 32 + 16).unwrap();
        assert!((lowest.depth - 0.01 * 15.5 / 16.0).abs() < 1e-6, "{lowest:?}");
    }

    #[test]
    fn corners_that_are_not_finite_cover_nothing() {
        let far = DVec3::new(0.0, 0.0, -5.0);
        assert!(covered([far, DVec3::new(f64::NAN, 0.0, -5.0), far + DVec3::X]).is_empty());
        assert!(covered([far, DVec3::new(0.0, f64::INFINITY, -5.0), far + DVec3::X]).is_empty());
    }
}
