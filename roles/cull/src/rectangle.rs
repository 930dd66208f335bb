//! The classic box test against a depth pyramid, by rectangles on the screen.

use crate::screen_box::ScreenProjection;
use crate::{DepthImage, DepthPyramid, HzbError, OcclusionTest, Outline, TestBox, View};

/// Tests boxes by their screen rectangles: a box is hidden only if its nearest depth is behind the at most
/// 2 x 2 texels that its rectangle covers. [`HzbTest`](crate::HzbTest) hides more; this one reads a constant
/// number of texels per box.
#[derive(Debug, Clone)]
pub struct RectangleTest<'p> {
    /// Without it no level is finer than the first.
    image: Option<DepthImage<'p>>,
    pyramid: &'p DepthPyramid,
}

impl<'p> RectangleTest<'p> {
    /// Tests against a `pyramid`, and the `image` that it was built over if that is at hand.
    #[must_use]
    pub const fn new(image: Option<DepthImage<'p>>, pyramid: &'p DepthPyramid) -> Self {
        Self { image, pyramid }
    }

    fn shows(&self, projection: &ScreenProjection, test_box: &TestBox) -> bool {
        let Some(footprint) = projection.footprint(test_box, projection.grown) else { return true };
        let Some(pixels) = footprint.pixels else { return false };
        let finest = usize::from(self.image.is_none());
        let index = pixels.level_of_four_texels().max(finest).min(self.pyramid.last_level());
        let level = self.pyramid.level(self.image, index);
        let mut rows = pixels.y0 >> index..=pixels.y1 >> index;
        rows.any(|y| {
            let mut columns = pixels.x0 >> index..=pixels.x1 >> index;
            columns.any(|x| {
                let hidden = footprint.nearest < f64::from(level.at(x, y));
                !hidden
            })
        })
    }
}

impl OcclusionTest for RectangleTest<'_> {
    type Error = HzbError;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), HzbError> {
        let size = view.viewport();
        let image = self.image.map(|image| Some(image.viewport()));
        let sizes = [Some(self.pyramid.viewport()), image].into_iter().flatten();
        if let Some(other) = sizes.into_iter().find(|other| *other != Some(size)) {
            return Err(HzbError::Size { image: size, other });
        }
        let projection = ScreenProjection::new(view, Outline::OnScreen);
        visible.clear();
        visible.extend(boxes.iter().map(|test_box| u32::from(self.shows(&projection, test_box))));
        Ok(())
    }

    fn outline(&self) -> Outline {
        Outline::OnScreen
    }
}
