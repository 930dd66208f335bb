//! A box as the screen sees it: its rectangle, its outline and the depth of its front.
//!
//! The reciprocal depth of a plane is linear on the screen. A ray enters the box at the farthest of its
//! front planes and leaves it at the nearest of its back planes, so at a pixel the entry is the *minimum* of
//! a few linear functions (depth is reversed), the exit the *maximum* of others, and the outline is where no
//! entry function is below an exit function. The extremes of a linear function over a rectangle of pixels are
//! exact and cheap.

use glam::{DVec3, Vec3};

use crate::boxes::OUTLINE_PX;
use crate::{Outline, TestBox, View};

/// Allowance for the rasterizer's sub-pixel grid (1/256) and for rounding here, in pixels.
pub(crate) const MARGIN_PX: f64 = 1.0 / 64.0;

/// Depths are taken to be nearer by this, relatively: more than the rounding of a division in f32.
const NEARER: f64 = 1e-6;

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
    /// The finest level at which the rectangle covers at most 5 x 5 texels.
    pub(crate) fn coarse_level(&self) -> usize {
        let longest = (self.x1 - self.x0).max(self.y1 - self.y0);
        if longest < 4 { 0 } else { longest.ilog2() as usize - 1 }
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
    /// What nearest depths are multiplied by.
    nearer: f64,
}

/// Where a box can show, and how near it comes.
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
    /// The rasterizer moves a surface sideways by up to half a sub-pixel step, and the steeper the surface,
    /// the more that moves its depth at a pixel: at the edge of a face seen at a grazing angle it may
    /// come out nearer than any part of the box. A box that is grown by half a pixel to all sides comes
    /// as much nearer, which covers any slope up to 256 metres of depth a metre across. Where outlines
    /// are grown on the screen only, depths get the same allowance here.
    pub(crate) fn new(view: &View, outline: Outline) -> Self {
        let steepness = match outline {
            Outline::OnScreen => OUTLINE_PX / view.focal_x().min(view.focal_y()),
            Outline::InBox => 0.0,
        };
        let (width, height) = (f64::from(view.viewport().width()), f64::from(view.viewport().height()));
        Self {
            near: f64::from(view.camera().near()),
            focal: (view.focal_x(), view.focal_y()),
            middle: (0.5 * width, 0.5 * height),
            last: (width - 1.0, height - 1.0),
            nearer: 1.0 + NEARER + steepness,
        }
    }

    /// The footprint of a box whose rectangle is grown by `grown` pixels; `None` where it reaches the eye's
    /// plane or is not finite.
    pub(crate) fn footprint(&self, test_box: &TestBox, grown: f64) -> Option<Footprint> {
        let centre = test_box.centre.as_dvec3();
        let [a, b, c] = test_box.axes.map(Vec3::as_dvec3);
        let thickness = a.z.abs() + b.z.abs() + c.z.abs();
        let (front, back) = (-centre.z - thickness, -centre.z + thickness);
        // Not even twice the smallest f32: below that reciprocals overflow.
        if !(front > f64::from(f32::MIN_POSITIVE) && (centre + a + b + c).is_finite()) {
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
#[derive(Debug, Clone, Copy, Default)]
struct Linear {
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
    nearer: f64,
}

/// At most N linear functions.
#[derive(Debug)]
struct Few<const N: usize> {
    functions: [Linear; N],
    count: usize,
}

impl<const N: usize> Few<N> {
    fn new() -> Self {
        Self { functions: [Linear::default(); N], count: 0 }
    }

    /// Adds one; beyond N it is left out, which only makes the shape larger.
    fn push(&mut self, function: Linear) {
        if let Some(slot) = self.functions.get_mut(self.count) {
            *slot = function;
            self.count += 1;
        }
    }

    fn iter(&self) -> impl Iterator<Item = &Linear> {
        self.functions.iter().take(self.count)
    }
}

impl ScreenShape {
    pub(crate) fn new(
        projection: &ScreenProjection,
        test_box: &TestBox,
        footprint: &Footprint,
        pixels: PixelRect,
        grown: f64,
    ) -> Self {
        let middle = (0.5 * (pixels.x0 + pixels.x1 + 1) as f64, 0.5 * (pixels.y0 + pixels.y1 + 1) as f64);
        let ray = DVec3::new(
            (middle.0 - projection.middle.0) / projection.focal.0,
            -(middle.1 - projection.middle.1) / projection.focal.1,
            -1.0,
        );
        let (mut fronts, mut backs) = (Few::<3>::new(), Few::<6>::new());
        for axis in test_box.axes.map(Vec3::as_dvec3) {
            let (along, half) = (axis.dot(test_box.centre.as_dvec3()), axis.length_squared());
            // A face at `axis . p = offset`; the eye is outside of it if its outward side has the origin.
            for (offset, outside) in [(along + half, along + half < 0.0), (along - half, along - half > 0.0)]
            {
                let scale = projection.near / offset;
                let plane = Linear {
                    middle: axis.dot(ray) * scale,
                    dx: axis.x * scale / projection.focal.0,
                    dy: -axis.y * scale / projection.focal.1,
                };
                // A plane through the eye is seen edge on and bounds nothing: leaving it out makes the shape
                // larger.
                if !scale.is_finite() {
                } else if outside {
                    fronts.push(plane);
                } else {
                    backs.push(plane);
                }
            }
        }
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
            grown,
            nearer: projection.nearer,
        }
    }

    /// How near the box's front can be (reversed depth) at the centres of these pixels.
    pub(crate) fn nearest_over(&self, pixels: PixelRect) -> f64 {
        let block = self.block(pixels, MARGIN_PX);
        let front = self
            .fronts
            .iter()
            .fold(self.nearest, |nearest, plane| nearest.min(plane.greatest(&block) * self.nearer));
        // In the margin around the outline the planes go on beyond the box.
        front.max(self.farthest)
    }

    /// Whether the grown outline misses the centres of all these pixels.
    pub(crate) fn misses(&self, pixels: PixelRect) -> bool {
        let block = self.block(pixels, self.grown);
        self.edges.iter().any(|edge| edge.greatest(&block) < 0.0)
    }

    fn block(&self, pixels: PixelRect, margin: f64) -> Block {
        Block {
            x: 0.5 * (pixels.x0 + pixels.x1 + 1) as f64 - self.middle.0,
            y: 0.5 * (pixels.y0 + pixels.y1 + 1) as f64 - self.middle.1,
            half_x: 0.5 * (pixels.x1 - pixels.x0) as f64 + margin,
            half_y: 0.5 * (pixels.y1 - pixels.y0) as f64 + margin,
        }
    }
}
