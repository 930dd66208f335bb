//! Box tests on the CPU against a depth pyramid.
//!
//! First the box's screen rectangle, with its nearest depth, is tested at a level where it covers a few
//! texels. This already hides most hidden boxes. Otherwise the true outline and the depth of the front faces
//! are tested down to single pixels, within a budget of texels; beyond the budget, the box counts as visible.
//!
//! The guarantee: a box is hidden only if at every pixel whose centre lies in its outline (grown as
//! [`Outline`] says) its front is behind the depth there. So it hides nothing that a rasterized test of the
//! same box shows; a little more may show.

use thiserror::Error;

use crate::screen_box::{Footprint, PixelRect, ScreenProjection, ScreenShape, Texel};
use crate::{DepthImage, DepthPyramid, OcclusionTest, Outline, TestBox, View, Viewport};

/// Texels read for one box before it counts as visible.
pub(crate) const BUDGET: u32 = 256;

/// Tests boxes against a depth image and the pyramid over it.
#[derive(Debug, Clone)]
pub struct HzbTest<'p> {
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

impl<'p> HzbTest<'p> {
    /// Tests against `image`, with the `pyramid` built over it. Outlines are grown here.
    ///
    /// # Errors
    /// If the pyramid was built over an image of another size.
    pub fn new(image: DepthImage<'p>, pyramid: &'p DepthPyramid) -> Result<Self, HzbError> {
        if pyramid.viewport() != Some(image.viewport()) {
            return Err(HzbError::Size { image: image.viewport(), other: pyramid.viewport() });
        }
        Ok(Self { image, pyramid, outline: Outline::OnScreen, stack: Vec::new() })
    }

    /// The same test with outlines grown as `outline` says. With [`Outline::InBox`] it takes the same boxes
    /// as a rasterizing test, for comparison.
    #[must_use]
    pub fn with_outline(self, outline: Outline) -> Self {
        Self { outline, ..self }
    }

    /// Whether the box is visible at any pixel.
    fn shows(&mut self, projection: &ScreenProjection, test_box: &TestBox) -> bool {
        let Some(footprint) = projection.footprint(test_box, projection.grown) else { return true };
        let Some(pixels) = footprint.pixels else { return false };
        let level_index = pixels.coarse_level().min(self.pyramid.last_level());
        let level = self.pyramid.level(Some(self.image), level_index);
        self.stack.clear();
        for y in pixels.y0 >> level_index..=pixels.y1 >> level_index {
            for x in pixels.x0 >> level_index..=pixels.x1 >> level_index {
                let hidden = footprint.nearest < f64::from(level.at(x, y));
                if !hidden {
                    self.stack.push(Texel { level: level_index, x, y });
                }
            }
        }
        !self.stack.is_empty() && self.shows_at_a_pixel(projection, test_box, &footprint, pixels)
    }

    /// Follows the texels on the stack down to a pixel at which the box is visible.
    fn shows_at_a_pixel(
        &mut self,
        projection: &ScreenProjection,
        test_box: &TestBox,
        footprint: &Footprint,
        pixels: PixelRect,
    ) -> bool {
        let shape = ScreenShape::new(projection, test_box, footprint, pixels);
        let mut looked_at = 0;
        while let Some(texel) = self.stack.pop() {
            looked_at += 1;
            if looked_at > BUDGET {
                return true;
            }
            let block = pixels.within(texel);
            let farthest = self.pyramid.level(Some(self.image), texel.level).at(texel.x, texel.y);
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

impl OcclusionTest for HzbTest<'_> {
    type Error = HzbError;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), HzbError> {
        if view.viewport() != self.image.viewport() {
            return Err(HzbError::Size { image: self.image.viewport(), other: Some(view.viewport()) });
        }
        let projection = ScreenProjection::new(view, self.outline);
        visible.clear();
        visible.extend(boxes.iter().map(|test_box| u32::from(self.shows(&projection, test_box))));
        Ok(())
    }

    fn outline(&self) -> Outline {
        self.outline
    }
}
