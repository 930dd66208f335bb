//! A box on the screen: its rectangle, its outline and the depth of its front.
//!
//! The reciprocal depth of a plane is linear on the screen. A ray enters the box at the farthest of its front
//! planes and leaves it at the nearest of its back planes, so at a pixel the entry is the *minimum* of a few
//! linear functions (depth is reversed), the exit the *maximum* of others, and the outline is where no entry
//! function is below an exit function. The extremes of a linear function over a rectangle of pixels are exact
//! and cheap.

use glam::{DVec3, Vec3};

use crate::{Outline, SubPixelGrid, TestBox, View};

/// Depths are taken to be nearer by this, relatively: more than the rounding of a division in f32.
const NEARER: f64 = 1e-6;

/// How far outlines are grown on the screen, in pixels.
pub(crate) fn grown(outline: Outline, grid: SubPixelGrid) -> f64 {
    match outline {
        Outline::OnScreen => grid.outline_px() + grid.margin_px(),
        Outline::InBox => grid.margin_px(),
    }
}

/// A texel of a depth pyramid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Texel {
    pub(crate) level: usize,
    pub(crate) x: usize,
    pub(crate) y: usize,
}

/// Pixels `x0..=x1`, `y0..=y1`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelRect {
    pub(crate) x0: usize,
    pub(crate) x1: usize,
    pub(crate) y0: usize,
    pub(crate) y1: usize,
}

impl PixelRect {
    /// A level at which the rectangle covers at most 5 x 5 texels: the finest, or the next coarser one.
    pub(crate) fn coarse_level(&self) -> usize {
        let longest = (self.x1 - self.x0).max(self.y1 - self.y0);
        if longest < 4 { 0 } else { longest.ilog2() as usize - 1 }
    }

    /// The finest level at which it covers at most 2 x 2 texels.
    pub(crate) fn level_of_four_texels(&self) -> usize {
        let mut level = 0;
        while (self.x1 >> level) - (self.x0 >> level) > 1 || (self.y1 >> level) - (self.y0 >> level) > 1 {
            level += 1;
        }
        level
    }

    /// Its middle on the screen.
    pub(crate) fn middle(&self) -> (f64, f64) {
        (0.5 * (self.x0 + self.x1 + 1) as f64, 0.5 * (self.y0 + self.y1 + 1) as f64)
    }

    /// The part of the rectangle in a texel that touches it.
    pub(crate) fn within(&self, texel: Texel) -> Self {
        let last = (1 << texel.level) - 1;
        let (left, top) = (texel.x << texel.level, texel.y << texel.level);
        Self {
            x0: self.x0.max(left),
            x1: self.x1.min(left + last),
            y0: self.y0.max(top),
            y1: self.y1.min(top + last),
        }
    }
}

/// From view space to the screen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScreenProjection {
    near: f64,
    focal: (f64, f64),
    middle: (f64, f64),
    last: (f64, f64),
    /// The factor for nearest depths.
    pub(crate) nearer: f64,
    /// How far from a pixel's centre a surface may lie that covers it, pixels.
    pub(crate) margin: f64,
    /// How far outlines are grown, pixels.
    pub(crate) grown: f64,
}

/// The screen extent of a box, and its nearest depth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Footprint {
    /// The pixels whose centres its grown rectangle holds, if any.
    pub(crate) pixels: Option<PixelRect>,
    /// Its nearest and its farthest depth, reversed.
    pub(crate) nearest: f64,
    pub(crate) farthest: f64,
}

impl ScreenProjection {
    /// The projection of `view`, for boxes whose outlines are grown as `outline` says.
    ///
    /// The rasterizer moves a surface sideways by up to half a sub-pixel step. The steeper the surface, the
    /// more this changes its depth at a pixel: at the edge of a face at a grazing angle it may come out
    /// nearer than any part of the box. A box grown by half a pixel to all sides gets nearer by as much,
    /// which covers any slope up to 256 metres of depth per metre across on a grid of 256 steps. If outlines
    /// are only grown on the screen, depths get the same allowance here.
    pub(crate) fn new(view: &View, outline: Outline) -> Self {
        let steepness = match outline {
            Outline::OnScreen => view.grid().outline_px() / view.focal_x().min(view.focal_y()),
            Outline::InBox => 0.0,
        };
        let (width, height) = (f64::from(view.viewport().width()), f64::from(view.viewport().height()));
        Self {
            near: f64::from(view.camera().near()),
            focal: (view.focal_x(), view.focal_y()),
            middle: (0.5 * width, 0.5 * height),
            last: (width - 1.0, height - 1.0),
            nearer: 1.0 + NEARER + steepness,
            margin: view.grid().margin_px(),
            grown: grown(outline, view.grid()),
        }
    }

    /// The focal lengths, the middle and the last pixel of the screen, each across and down.
    pub(crate) fn focal_middle_last(&self) -> [[f64; 2]; 3] {
        [self.focal, self.middle, self.last].map(|(x, y)| [x, y])
    }

    /// The footprint of a box whose rectangle is grown by `grown` pixels; `None` if it reaches the eye's
    /// plane or is not finite.
    pub(crate) fn footprint(&self, test_box: &TestBox, grown: f64) -> Option<Footprint> {
        let centre = test_box.centre.as_dvec3();
        let [a, b, c] = test_box.axes.map(Vec3::as_dvec3);
        let thickness = a.z.abs() + b.z.abs() + c.z.abs();
        let (front, back) = (-centre.z - thickness, -centre.z + thickness);
        let is_finite = [centre, a, b, c].iter().all(|v| v.is_finite());
        // Not even twice the smallest f32: below that reciprocals overflow.
        if !(front > f64::from(f32::MIN_POSITIVE) && is_finite) {
            return None;
        }
        let (mut low, mut high) = ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
        let (one, other) = (centre + c, centre - c);
        for side in [a + b, a - b, b - a, -a - b] {
            for corner in [one + side, other + side] {
                let inverse = -1.0 / corner.z;
                let (x, y) = (corner.x * inverse, -corner.y * inverse);
                low = (low.0.min(x), low.1.min(y));
                high = (high.0.max(x), high.1.max(y));
            }
        }
        let span = |low: f64, high: f64, focal: f64, middle: f64, last: f64| {
            let first = (middle + focal * low - grown - 0.5).ceil().max(0.0);
            let end = (middle + focal * high + grown - 0.5).floor().min(last);
            (first <= end).then_some((first as usize, end as usize))
        };
        let columns = span(low.0, high.0, self.focal.0, self.middle.0, self.last.0);
        let rows = span(low.1, high.1, self.focal.1, self.middle.1, self.last.1);
        let pixels = match (columns, rows) {
            (Some((x0, x1)), Some((y0, y1))) => Some(PixelRect { x0, x1, y0, y1 }),
            _ => None,
        };
        Some(Footprint { pixels, nearest: self.near / front * self.nearer, farthest: self.near / back })
    }
}

/// A linear function on the screen, about the middle of the box's rectangle.
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Linear {
    middle: f64,
    dx: f64,
    dy: f64,
}

impl Linear {
    /// Its greatest value on a block.
    fn greatest(&self, block: &Block) -> f64 {
        self.middle
            + self.dx * block.x
            + self.dy * block.y
            + self.dx.abs() * block.half_x
            + self.dy.abs() * block.half_y
    }
}

/// A rectangle of the screen, about the middle of the box's rectangle.
#[derive(Debug, Clone, Copy)]
struct Block {
    x: f64,
    y: f64,
    half_x: f64,
    half_y: f64,
}

/// A box's outline and front on the screen, as linear functions of reversed depth.
#[derive(Debug)]
pub(crate) struct ScreenShape {
    /// Front planes: the front is their minimum.
    fronts: Few<3>,
    /// A front plane less a back plane: the outline is where all are at least 0.
    edges: Few<9>,
    nearest: f64,
    farthest: f64,
    middle: (f64, f64),
    grown: f64,
    margin: f64,
    nearer: f64,
}

/// At most N linear functions.
#[derive(Debug)]
pub(crate) struct Few<const N: usize> {
    functions: [Linear; N],
    count: usize,
}

impl<const N: usize> Few<N> {
    fn new() -> Self {
        Self { functions: [Linear::default(); N], count: 0 }
    }

    /// Adds one; beyond N it is ignored, which only makes the shape larger.
    fn push(&mut self, function: Linear) {
        if let Some(slot) = self.functions.get_mut(self.count) {
            *slot = function;
            self.count += 1;
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &Linear> {
        self.functions.iter().take(self.count)
    }
}

/// The planes of a box's faces on the screen.
#[derive(Debug)]
pub(crate) struct Planes {
    /// Those that face the eye.
    pub(crate) fronts: Few<3>,
    pub(crate) backs: Few<6>,
}

impl Planes {
    /// About `middle`, the middle of the box's rectangle.
    pub(crate) fn new(projection: &ScreenProjection, test_box: &TestBox, middle: (f64, f64)) -> Self {
        let ray = DVec3::new(
            (middle.0 - projection.middle.0) / projection.focal.0,
            -(middle.1 - projection.middle.1) / projection.focal.1,
            -1.0,
        );
        let (mut fronts, mut backs) = (Few::<3>::new(), Few::<6>::new());
        for axis in test_box.axes.map(Vec3::as_dvec3) {
            let (along, half) = (axis.dot(test_box.centre.as_dvec3()), axis.length_squared());
            // A face at `axis . p = offset`; the eye is outside of it if the origin is on its outer side.
            for (offset, outside) in [(along + half, along + half < 0.0), (along - half, along - half > 0.0)]
            {
                let scale = projection.near / offset;
                let plane = Linear {
                    middle: axis.dot(ray) * scale,
                    dx: axis.x * scale / projection.focal.0,
                    dy: -axis.y * scale / projection.focal.1,
                };
                // A plane through the eye is edge-on and bounds nothing: omitting it makes the shape larger.
                if !scale.is_finite() {
                } else if outside {
                    fronts.push(plane);
                } else {
                    backs.push(plane);
                }
            }
        }
        Self { fronts, backs }
    }
}

impl ScreenShape {
    pub(crate) fn new(
        projection: &ScreenProjection,
        test_box: &TestBox,
        footprint: &Footprint,
        pixels: PixelRect,
    ) -> Self {
        let middle = pixels.middle();
        let Planes { fronts, backs } = Planes::new(projection, test_box, middle);
        let mut edges = Few::new();
        for front in fronts.iter() {
            for back in backs.iter() {
                edges.push(Linear {
                    middle: front.middle - back.middle,
                    dx: front.dx - back.dx,
                    dy: front.dy - back.dy,
                });
            }
        }
        Self {
            fronts,
            edges,
            nearest: footprint.nearest,
            farthest: footprint.farthest,
            middle,
            grown: projection.grown,
            margin: projection.margin,
            nearer: projection.nearer,
        }
    }

    /// The nearest possible depth (reversed) of the box's front at the centres of these pixels.
    pub(crate) fn nearest_over(&self, pixels: PixelRect) -> f64 {
        let block = self.block(pixels, self.margin);
        let front = self
            .fronts
            .iter()
            .fold(self.nearest, |nearest, plane| nearest.min(plane.greatest(&block) * self.nearer));
        // In the margin around the outline the planes continue beyond the box.
        front.max(self.farthest)
    }

    /// Whether the grown outline misses the centres of all these pixels.
    pub(crate) fn misses(&self, pixels: PixelRect) -> bool {
        let block = self.block(pixels, self.grown);
        self.edges.iter().any(|edge| edge.greatest(&block) < 0.0)
    }

    fn block(&self, pixels: PixelRect, margin: f64) -> Block {
        let (x, y) = pixels.middle();
        Block {
            x: x - self.middle.0,
            y: y - self.middle.1,
            half_x: 0.5 * (pixels.x1 - pixels.x0) as f64 + margin,
            half_y: 0.5 * (pixels.y1 - pixels.y0) as f64 + margin,
        }
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{Camera, FrameNumber};
    use trimaran_scene::random::Random;

    use super::*;
    use crate::Viewport;

    /// 100 x 80 pixels down -z; 80 pixels to the metre at a depth of one metre.
    fn view() -> View {
        let viewport = Viewport::new(100, 80).unwrap();
        let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 0.01, FrameNumber(0));
        View::new(camera.unwrap(), viewport)
    }

    fn upright(centre: Vec3, half: Vec3) -> TestBox {
        TestBox { centre, axes: [Vec3::X * half.x, Vec3::Y * half.y, Vec3::Z * half.z] }
    }

    #[test]
    fn a_rectangle_covers_few_texels_of_its_coarse_level_and_more_of_the_next_finer_one() {
        for (start, longest) in (0..40).flat_map(|start| (0..200).map(move |longest| (start, longest))) {
            let columns = PixelRect { x0: start, x1: start + longest, y0: 7, y1: 7 };
            let rows = PixelRect { x0: 7, x1: 7, y0: start, y1: start + longest };
            let level = columns.coarse_level();
            assert_eq!(rows.coarse_level(), level);
            let texels = |level: usize| ((start + longest) >> level) - (start >> level) + 1;
            assert!(texels(level) <= 5, "{longest} pixels from {start}");
            assert!(level == 0 || texels(level - 1) >= 5, "{longest} pixels from {start}");
            let level = columns.level_of_four_texels();
            assert_eq!(rows.level_of_four_texels(), level);
            assert!(texels(level) <= 2, "{longest} pixels from {start}");
            assert!(level == 0 || texels(level - 1) > 2, "{longest} pixels from {start}");
        }
        // It rises at each power of two, where five texels of the finer level would still do.
        let coarse = |x1: usize| PixelRect { x0: 0, x1, y0: 0, y1: 0 }.coarse_level();
        assert_eq!([3, 4, 7, 8, 15, 16].map(coarse), [0, 1, 1, 2, 2, 3]);
    }

    #[test]
    fn a_texel_cuts_a_rectangle() {
        let rect = PixelRect { x0: 3, x1: 10, y0: 5, y1: 18 };
        let PixelRect { x0, x1, y0, y1 } = rect.within(Texel { level: 2, x: 1, y: 2 });
        assert_eq!([x0, x1, y0, y1], [4, 7, 8, 11]);
        let PixelRect { x0, x1, y0, y1 } = rect.within(Texel { level: 3, x: 0, y: 2 });
        assert_eq!([x0, x1, y0, y1], [3, 7, 16, 18]);
    }

    /// A box from 5 to 6 m, from -0.9 to 1.1 m across and from -0.7 to 0.3 m up.
    #[test]
    fn a_footprint_has_the_pixels_whose_centres_are_in_the_grown_rectangle() {
        let test_box = upright(Vec3::new(0.1, -0.2, -5.5), Vec3::new(1.0, 0.5, 0.5));
        let of = |outline, test_box: &TestBox, grown| {
            let found = ScreenProjection::new(&view(), outline).footprint(test_box, grown)?;
            let pixels = found.pixels.map(|PixelRect { x0, x1, y0, y1 }| [x0, x1, y0, y1]);
            Some((pixels, found.nearest, found.farthest))
        };
        // Columns 50 - 14.4 to 50 + 17.6, rows 40 - 4.8 to 40 + 11.2.
        let (pixels, nearest, farthest) = of(Outline::InBox, &test_box, 0.0).unwrap();
        assert_eq!(pixels, Some([36, 67, 35, 50]));
        let near = f64::from(0.01_f32);
        assert!(nearest >= near / 5.0 && nearest < near / 5.0 * (1.0 + 2.0 * NEARER), "{nearest}");
        assert!((farthest * 6.0 / near - 1.0).abs() < 1e-6, "{farthest}");
        let (pixels, nearest, _) = of(Outline::OnScreen, &test_box, 0.5).unwrap();
        assert_eq!(pixels, Some([35, 67, 35, 51]));
        assert!(
            (nearest * 5.0 / near - 1.0 - view().grid().outline_px() / 80.0).abs() < 2.0 * NEARER,
            "{nearest}"
        );

        let moved = |by: Vec3| of(Outline::InBox, &TestBox { centre: test_box.centre + by, ..test_box }, 0.0);
        assert_eq!(moved(Vec3::X * 3.0).unwrap().0, Some([78, 99, 35, 50]), "cut at the last column");
        assert_eq!(moved(Vec3::Y * -2.5).unwrap().0, Some([36, 67, 69, 79]), "cut at the last row");
        assert_eq!(moved(Vec3::X * 9.0).unwrap().0, None, "beside the picture");
        assert_eq!(moved(Vec3::Y * 9.0).unwrap().0, None, "above the picture");
        assert!(moved(Vec3::Z * 4.9).is_some() && moved(Vec3::Z * 5.1).is_none(), "at the eye's plane");
        let tiny = |depth: f32| upright(Vec3::Z * -depth * f32::MIN_POSITIVE, Vec3::Z * f32::MIN_POSITIVE);
        let found = [2.0, 3.0].map(|depth| of(Outline::InBox, &tiny(depth), 0.0).is_some());
        assert_eq!(found, [false, true], "at the smallest f32");
    }

    /// A box whose right side is a 64th of a pixel left of the centres of column 5, by exact numbers.
    #[test]
    fn an_outline_that_just_touches_a_pixel_s_centre_does_not_miss_it() {
        let right = 95.0 / 128.0;
        let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, right, FrameNumber(0)).unwrap();
        let view = View::new(camera, Viewport::new(8, 8).unwrap());
        let test_box = upright(Vec3::new(right - 0.5, 0.0, -4.5), Vec3::splat(0.5));
        let projection = ScreenProjection::new(&view, Outline::InBox);
        let footprint = projection.footprint(&test_box, projection.grown).unwrap();
        let rect = footprint.pixels.unwrap();
        assert_eq!([rect.x0, rect.x1, rect.y0, rect.y1], [3, 5, 3, 4]);
        let shape = ScreenShape::new(&projection, &test_box, &footprint, rect);
        let misses = |x| shape.misses(PixelRect { x0: x, x1: x, y0: 4, y1: 4 });
        assert_eq!([4, 5, 6].map(misses), [false, false, true]);
    }

    #[test]
    fn a_footprint_is_that_of_the_eight_corners() {
        let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 0.01, FrameNumber(0)).unwrap();
        let projection =
            ScreenProjection::new(&View::new(camera, Viewport::new(100, 80).unwrap()), Outline::OnScreen);
        let near = f64::from(0.01_f32);
        let mut random = Random::new(8);
        for _ in 0..200 {
            let turn = random.rotation();
            let axes = [DVec3::X * 0.3, DVec3::Y * 0.5, DVec3::Z * 0.8].map(|axis| (turn * axis).as_vec3());
            let test_box = TestBox { centre: Vec3::new(0.02, -0.03, -9.0), axes };
            let [a, b, c] = axes.map(Vec3::as_dvec3);
            let signs = [-1.0, 1.0];
            let corners = signs.iter().flat_map(|i| signs.iter().flat_map(move |j| signs.map(|k| (i, j, k))));
            let corners: Vec<DVec3> =
                corners.map(|(i, j, k)| test_box.centre.as_dvec3() + a * i + b * j + c * k).collect();
            let range = |of: fn(DVec3) -> f64| {
                let all = corners.iter().map(|&corner| of(corner));
                (all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max))
            };
            let (left, right) = range(|p| 49.5 + 80.0 * p.x / -p.z);
            let (top, bottom) = range(|p| 39.5 - 80.0 * p.y / -p.z);
            let (front, back) = range(|p| -p.z);
            let found = projection.footprint(&test_box, 0.0).unwrap();
            let PixelRect { x0, x1, y0, y1 } = found.pixels.unwrap();
            let expected = [left.ceil(), right.floor(), top.ceil(), bottom.floor()];
            assert_eq!([x0, x1, y0, y1].map(|pixel| pixel as f64), expected, "{test_box:?}");
            let nearest = near / front * (1.0 + view().grid().outline_px() / 80.0);
            assert!((found.nearest / nearest - 1.0).abs() < 1e-5, "{} {nearest}", found.nearest);
            assert!((found.farthest * back / near - 1.0).abs() < 1e-6, "{}", found.farthest);
        }
    }

    /// A box for ray casting.
    struct Slabs(Vec<Face>);

    struct Face {
        outwards: DVec3,
        offset: f64,
    }

    impl Slabs {
        fn of(test_box: &TestBox) -> Self {
            let face = |axis: DVec3| Face {
                outwards: axis,
                offset: axis.dot(test_box.centre.as_dvec3()) + axis.length_squared(),
            };
            Self(test_box.axes.map(Vec3::as_dvec3).iter().flat_map(|&a| [face(a), face(-a)]).collect())
        }

        /// The reversed depth at which the ray through a point of the screen passes each front face.
        fn fronts(&self, x: f64, y: f64) -> impl Iterator<Item = f64> {
            let ray = ray(x, y);
            self.0
                .iter()
                .filter(|face| face.offset < 0.0)
                .map(move |face| f64::from(0.01_f32) * face.outwards.dot(ray) / face.offset)
        }

        /// Whether the ray hits the box: whether it enters the last front face before it leaves the first
        /// back face.
        fn is_hit(&self, x: f64, y: f64) -> bool {
            let ray = ray(x, y);
            let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
            for Face { outwards, offset } in &self.0 {
                let along = outwards.dot(ray);
                let at = offset / along;
                if along < 0.0 {
                    enter = enter.max(at);
                } else {
                    leave = leave.min(at);
                }
            }
            enter <= leave
        }
    }

    /// From the eye through a point of the screen, one metre deep.
    fn ray(x: f64, y: f64) -> DVec3 {
        DVec3::new((x - 50.0) / 80.0, (40.0 - y) / 80.0, -1.0)
    }

    #[test]
    fn outline_and_front_are_those_that_rays_find() {
        let mut random = Random::new(3);
        let (mut hit, mut missed, mut outside) = (0, 0, 0);
        for _ in 0..300 {
            let depth = random.between(1.0, 20.0);
            let middle = DVec3::new(random.between(-0.6, 0.6), random.between(-0.5, 0.5), -1.0) * depth;
            let turn = random.rotation();
            let axes = [DVec3::X, DVec3::Y, DVec3::Z]
                .map(|axis| (turn * axis * depth * 0.2 * random.between(0.1, 1.0)).as_vec3());
            let test_box = TestBox { centre: middle.as_vec3(), axes };
            let projection = ScreenProjection::new(&view(), Outline::InBox);
            let Some(footprint) = projection.footprint(&test_box, projection.grown) else {
                panic!("{test_box:?}")
            };
            let Some(rect) = footprint.pixels else { continue };
            let shape = ScreenShape::new(&projection, &test_box, &footprint, rect);
            let slabs = Slabs::of(&test_box);
            for block in (0..4).flat_map(|level| blocks(rect, level)) {
                // Each front plane's greatest depth is at a corner of the block.
                let corners =
                    [block.x0 as f64 + 0.5 - projection.margin, block.x1 as f64 + 0.5 + projection.margin]
                        .map(|x| {
                            [
                                block.y0 as f64 + 0.5 - projection.margin,
                                block.y1 as f64 + 0.5 + projection.margin,
                            ]
                            .map(|y| (x, y))
                        });
                let greatest = corners
                    .as_flattened()
                    .iter()
                    .map(|&(x, y)| slabs.fronts(x, y).collect())
                    .reduce(|a: Vec<f64>, b| a.iter().zip(&b).map(|(a, b)| a.max(*b)).collect());
                let front = greatest.unwrap().into_iter().fold(f64::INFINITY, f64::min) * (1.0 + NEARER);
                let expected = front.min(footprint.nearest).max(footprint.farthest);
                let found = shape.nearest_over(block);
                assert!((found / expected - 1.0).abs() < 1e-9, "{found}, not {expected}: {test_box:?}");

                let centres = (block.y0..=block.y1).flat_map(|y| (block.x0..=block.x1).map(move |x| (x, y)));
                let shows = centres.clone().any(|(x, y)| slabs.is_hit(x as f64 + 0.5, y as f64 + 0.5));
                assert!(!(shows && shape.misses(block)), "{block:?} of {test_box:?}");
                if block.x0 == block.x1 && block.y0 == block.y1 {
                    hit += u32::from(shows);
                    outside += u32::from(!shows);
                    missed += u32::from(shape.misses(block));
                }
            }
        }
        assert!(hit > 10_000 && outside > 10_000, "{hit} {outside}");
        // All but a few pixels whose centres are within the margin of the outline.
        assert!(missed * 50 > outside * 49, "{missed} of {outside}");
    }

    /// A rectangle's parts in the texels of a level.
    fn blocks(rect: PixelRect, level: usize) -> impl Iterator<Item = PixelRect> {
        let texels = move |low: usize, high: usize| low >> level..=high >> level;
        texels(rect.y0, rect.y1)
            .flat_map(move |y| texels(rect.x0, rect.x1).map(move |x| rect.within(Texel { level, x, y })))
    }
}
