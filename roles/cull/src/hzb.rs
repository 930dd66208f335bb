//! Testing boxes on the CPU against a depth pyramid.
//!
//! First the box's rectangle on the screen with its nearest depth is tested against a level at which it
//! covers a few texels. Most hidden boxes end there. Where that does not hide the box, its true outline and
//! the depth of its front faces are tested down to single pixels, as far as a budget of texels goes; when
//! that is spent, the box counts as visible.
//!
//! The promise: a box is hidden only if at every pixel whose centre lies in its outline (grown as [`Outline`]
//! says) its front is behind the depth there. So nothing that a rasterized test of the same box shows is
//! hidden; a little more may show.

use thiserror::Error;

use crate::boxes::OUTLINE_PX;
use crate::screen_box::{Footprint, Lens, MARGIN_PX, PixelRect, ScreenShape, Texel};
use crate::{BoxTester, DepthImage, DepthPyramid, Outline, TestBox, View, Viewport};

/// Texels looked at for one box before it counts as visible.
const BUDGET: u32 = 256;

/// Tests boxes against a depth image and the pyramid over it.
#[derive(Debug, Clone)]
pub struct HzbTester<'p> {
    image: DepthImage<'p>,
    pyramid: &'p DepthPyramid,
    outline: Outline,
    stack: Vec<Texel>,
}

/// Why boxes cannot be tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum HzbError {
    /// The view's picture, or the pyramid, has another size than the depth image.
    #[error(
        "a depth image of {} x {} pixels against {}: both must be of the view's size",
        image.width(), image.height(), OtherSize(*other)
    )]
    Size {
        /// The depth image's size.
        image: Viewport,
        /// The other size; none if the pyramid was never built.
        other: Option<Viewport>,
    },
}

struct OtherSize(Option<Viewport>);

impl std::fmt::Display for OtherSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Some(size) => write!(f, "{} x {} pixels", size.width(), size.height()),
            None => f.write_str("a pyramid that was never built"),
        }
    }
}

impl<'p> HzbTester<'p> {
    /// Tests against `image`, over which `pyramid` was built. The tester grows outlines itself.
    ///
    /// # Errors
    /// If the pyramid was built over an image of another size.
    pub fn new(image: DepthImage<'p>, pyramid: &'p DepthPyramid) -> Result<Self, HzbError> {
        if pyramid.viewport() != Some(image.viewport()) {
            return Err(HzbError::Size { image: image.viewport(), other: pyramid.viewport() });
        }
        Ok(Self { image, pyramid, outline: Outline::OnScreen, stack: Vec::new() })
    }

    /// The same tester with outlines grown as `outline` says: with [`Outline::InBox`] it takes boxes as a
    /// tester that rasterizes them does, so that the two can be compared.
    #[must_use]
    pub fn with_outline(self, outline: Outline) -> Self {
        Self { outline, ..self }
    }

    /// Whether the box shows at any pixel.
    fn shows(&mut self, lens: &Lens, test_box: &TestBox) -> bool {
        let grown = match self.outline {
            Outline::OnScreen => OUTLINE_PX + MARGIN_PX,
            Outline::InBox => MARGIN_PX,
        };
        let Some(footprint) = lens.footprint(test_box, grown) else { return true };
        let Some(pixels) = footprint.pixels else { return false };
        let level_index = pixels.coarse_level().min(self.pyramid.last_level());
        let level = self.pyramid.level(self.image, level_index);
        self.stack.clear();
        for y in pixels.y0 >> level_index..=pixels.y1 >> level_index {
            for x in pixels.x0 >> level_index..=pixels.x1 >> level_index {
                let hidden = footprint.nearest < f64::from(level.at(x, y));
                if !hidden {
                    self.stack.push(Texel { level: level_index, x, y });
                }
            }
        }
        !self.stack.is_empty() && self.shows_at_a_pixel(lens, test_box, &footprint, pixels, grown)
    }

    /// Follows the texels on the stack down to a pixel at which the box shows.
    fn shows_at_a_pixel(
        &mut self,
        lens: &Lens,
        test_box: &TestBox,
        footprint: &Footprint,
        pixels: PixelRect,
        grown: f64,
    ) -> bool {
        let shape = ScreenShape::new(lens, test_box, footprint, pixels, grown);
        let mut looked_at = 0;
        while let Some(texel) = self.stack.pop() {
            looked_at += 1;
            if looked_at > BUDGET {
                return true;
            }
            let block = pixels.within(texel);
            let farthest = self.pyramid.level(self.image, texel.level).at(texel.x, texel.y);
            if shape.nearest_over(block) < f64::from(farthest) || shape.misses(block) {
                continue;
            }
            let Some(level) = texel.level.checked_sub(1) else { return true };
            for y in block.y0 >> level..=block.y1 >> level {
                for x in block.x0 >> level..=block.x1 >> level {
                    self.stack.push(Texel { level, x, y });
                }
            }
        }
        false
    }
}

impl BoxTester for HzbTester<'_> {
    type Error = HzbError;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), HzbError> {
        if view.viewport() != self.image.viewport() {
            return Err(HzbError::Size { image: self.image.viewport(), other: Some(view.viewport()) });
        }
        let lens = Lens::new(view, self.outline);
        visible.clear();
        visible.extend(boxes.iter().map(|test_box| u32::from(self.shows(&lens, test_box))));
        Ok(())
    }

    fn outline(&self) -> Outline {
        self.outline
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::reference::cases::{Dice, looking};
    use crate::reference::{Picture, ReferenceTester, rasterize_triangle};

    fn random_box(dice: &mut Dice) -> TestBox {
        let depth = dice.between(-2.0, 5.0).exp2();
        let centre =
            DVec3::new(dice.between(-0.8, 0.8) * depth, dice.between(-0.8, 0.8) * depth, -depth - 0.1);
        let turn = dice.rotation();
        let axes = [DVec3::X, DVec3::Y, DVec3::Z]
            .map(|axis| (turn * axis * depth * 0.4 * dice.between(-9.0, 0.0).exp2()).as_vec3());
        TestBox { centre: centre.as_vec3(), axes }
    }

    /// Against random triangles at sizes from one pixel up: a box that a rasterized test shows is never
    /// hidden, and most of those that it hides are.
    #[test]
    fn nothing_that_a_rasterized_test_shows_is_hidden() {
        let mut dice = Dice::new(9);
        let (mut both_hide, mut reference_hides) = (0, 0);
        for round in 0..60 {
            let (width, height) = [(64, 48), (1, 1), (1, 33), (77, 31), (127, 129)][round % 5];
            let fov = [60.0, 100.0, 20.0][round % 3];
            let viewport = Viewport::new(width, height).unwrap();
            let view = looking(DVec3::ZERO, DVec3::Y, fov, viewport, 0).unwrap();
            let mut occluders = Picture::new(viewport);
            for _ in 0..12 {
                let wall = random_box(&mut dice);
                let [a, b] = [wall.axes[0] * 9.0, wall.axes[1] * 9.0].map(Vec3::as_dvec3);
                let centre = wall.centre.as_dvec3();
                rasterize_triangle(&view, [centre + a, centre - a + b, centre - a - b], |hit| {
                    occluders.cover(hit);
                });
            }
            let depth = occluders.depth32();
            let image = DepthImage::new(viewport, &depth).unwrap();
            let mut pyramid = DepthPyramid::new();
            pyramid.rebuild(image);
            let boxes: Vec<TestBox> = (0..200).map(|_| random_box(&mut dice)).collect();
            let (mut exact, mut fast) = (Vec::new(), Vec::new());
            ReferenceTester::new(&occluders).test(&view, &boxes, &mut exact).unwrap();
            let mut tester = HzbTester::new(image, &pyramid).unwrap().with_outline(Outline::InBox);
            tester.test(&view, &boxes, &mut fast).unwrap();
            for (test_box, (&count, &shows)) in boxes.iter().zip(exact.iter().zip(&fast)) {
                let beyond_near =
                    -test_box.centre.z - test_box.axes.iter().map(|a| a.z.abs()).sum::<f32>() > 0.011;
                if !beyond_near {
                    continue;
                }
                assert!(
                    count == 0 || shows == 1,
                    "{count} pixels of {test_box:?} show at {width} x {height}, fov {fov}"
                );
                reference_hides += u32::from(count == 0);
                both_hide += u32::from(count == 0 && shows == 0);
            }
        }
        assert!(f64::from(both_hide) > 0.9 * f64::from(reference_hides), "{both_hide} of {reference_hides}");
    }

    #[test]
    fn a_box_that_cannot_be_judged_shows() {
        let viewport = Viewport::new(8, 8).unwrap();
        let view = looking(DVec3::ZERO, DVec3::Y, 60.0, viewport, 0).unwrap();
        let nearest = [1.0; 64];
        let image = DepthImage::new(viewport, &nearest).unwrap();
        let mut pyramid = DepthPyramid::new();
        pyramid.rebuild(image);
        let sound = TestBox { centre: Vec3::new(0.0, 0.0, -5.0), axes: [Vec3::X, Vec3::Y, Vec3::Z] };
        let around_the_eye = TestBox { centre: Vec3::ZERO, ..sound };
        let nan = TestBox { centre: Vec3::new(f32::NAN, 0.0, -5.0), ..sound };
        let infinite = TestBox { axes: [Vec3::X * f32::INFINITY, Vec3::Y, Vec3::Z], ..sound };
        let mut answers = Vec::new();
        let mut tester = HzbTester::new(image, &pyramid).unwrap();
        tester.test(&view, &[sound, around_the_eye, nan, infinite], &mut answers).unwrap();
        assert_eq!(answers, [0, 1, 1, 1]);
    }

    /// A plate of a real platform, seen almost along its side, whose corner falls on pixel centres. The
    /// rasterizer moved the side outwards by a 540th of a pixel; there its depth is 0.5 mm nearer than
    /// any corner.
    #[test]
    fn a_side_that_the_rasterizer_moves_past_its_corner_does_not_hide_its_box() {
        let viewport = Viewport::new(384, 384).unwrap();
        let view = looking(DVec3::ZERO, DVec3::Y, 60.0, viewport, 0).unwrap();
        let plate = TestBox {
            centre: Vec3::new(-4.492_045_4, -8.861_727, -15.525_961),
            axes: [
                Vec3::new(0.0, 0.938_035_37, 0.0),
                Vec3::new(-0.036_934_294, 0.0, -0.354_617_18),
                Vec3::new(-0.037_333_414, 0.0, 0.003_888_371_4),
            ],
        };
        let mut depth = vec![1.0; 384 * 384];
        for row in 379..384 {
            depth[row * 384 + 93] = view.camera().near() / 15.167_034;
        }
        let image = DepthImage::new(viewport, &depth).unwrap();
        let mut pyramid = DepthPyramid::new();
        pyramid.rebuild(image);
        let mut answers = Vec::new();
        HzbTester::new(image, &pyramid).unwrap().test(&view, &[plate], &mut answers).unwrap();
        assert_eq!(answers, [1]);
    }

    #[test]
    fn sizes_must_agree() {
        let depth = [0.0; 6];
        let image = DepthImage::new(Viewport::new(3, 2).unwrap(), &depth).unwrap();
        let mut pyramid = DepthPyramid::new();
        assert!(HzbTester::new(image, &pyramid).is_err());
        pyramid.rebuild(image);
        let mut tester = HzbTester::new(image, &pyramid).unwrap();
        let view = looking(DVec3::ZERO, DVec3::Y, 60.0, Viewport::new(2, 3).unwrap(), 0).unwrap();
        let error = tester.test(&view, &[], &mut Vec::new()).unwrap_err();
        let message = "a depth image of 3 x 2 pixels against 2 x 3 pixels: both must be of the view's size";
        assert_eq!(error.to_string(), message);
    }
}
