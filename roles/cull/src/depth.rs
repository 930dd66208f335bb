//! A depth buffer and its pyramid of farthest depths (hierarchical z-buffer; Greene, Kass and Miller, 1993).
//!
//! Depth is reversed: near / distance, 0 for the background, so the farthest of several is their minimum.
//! Level 0 is the depth buffer itself; a texel of level k holds the farthest depth of the pixels `x << k ..
//! (x + 1) << k`, as far as the picture goes, and likewise in y. Each level is half the size of the one
//! before it *rounded up*: at odd sizes the last column and row stand for themselves, and no border pixel is
//! lost.

use thiserror::Error;

use crate::Viewport;

/// A picture's depth values: reversed z (near / distance), 0 for the background, row 0 at the top, none of
/// them NaN. Sampled at pixel centres, so the sample of column x is at x + 0.5 pixels.
#[derive(Debug, Clone, Copy)]
pub struct DepthImage<'d> {
    viewport: Viewport,
    depth: &'d [f32],
}

/// The number of depth values does not match the picture's size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{values} depth values for a picture of {} x {} pixels", viewport.width(), viewport.height())]
pub struct DepthImageError {
    /// The picture's size.
    pub viewport: Viewport,
    /// The number of values.
    pub values: usize,
}

impl<'d> DepthImage<'d> {
    /// `depth` as the rows of a picture, top to bottom.
    ///
    /// # Errors
    /// If there is not one value per pixel.
    pub fn new(viewport: Viewport, depth: &'d [f32]) -> Result<Self, DepthImageError> {
        if depth.len() as u64 == u64::from(viewport.width()) * u64::from(viewport.height()) {
            Ok(Self { viewport, depth })
        } else {
            Err(DepthImageError { viewport, values: depth.len() })
        }
    }

    /// The picture's size.
    #[must_use]
    pub const fn viewport(&self) -> Viewport {
        self.viewport
    }

    /// The values, row by row.
    #[must_use]
    pub const fn depth(&self) -> &'d [f32] {
        self.depth
    }
}

/// The coarser levels over a depth image; none at first. Keep one and rebuild it each frame: it reuses its
/// memory.
#[derive(Debug, Clone, Default)]
pub struct DepthPyramid {
    /// Level k + 1 of the pyramid at k, until one texel is left.
    levels: Vec<Level>,
    finest: Option<Viewport>,
}

/// One level, row by row.
#[derive(Debug, Clone, Default)]
struct Level {
    width: usize,
    height: usize,
    farthest: Vec<f32>,
}

/// A level for reading.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Texels<'p> {
    width: usize,
    values: &'p [f32],
}

impl Texels<'_> {
    /// The farthest depth in texel (x, y); the background's outside of the picture, where nothing can hide.
    #[inline]
    pub(crate) fn at(&self, x: usize, y: usize) -> f32 {
        self.values.get(y * self.width + x).copied().unwrap_or(0.0)
    }
}

impl DepthPyramid {
    /// All levels over `image`.
    #[must_use]
    pub fn over(image: DepthImage<'_>) -> Self {
        let mut pyramid = Self::default();
        pyramid.rebuild(image);
        pyramid
    }

    /// Builds all levels over `image`.
    pub fn rebuild(&mut self, image: DepthImage<'_>) {
        let viewport = image.viewport();
        self.reduce(viewport.width() as usize, viewport.height() as usize, 0, image.depth());
        self.finest = Some(viewport);
    }

    /// Builds the levels over `half`, which is level 1 of a picture of size `viewport`: a device has reduced
    /// the depth once. A picture of one pixel is its own level 1. Texels that `half` lacks are background.
    pub fn rebuild_over_half(&mut self, viewport: Viewport, half: &[f32]) {
        let [width, height] = [viewport.width(), viewport.height()].map(|side| side.div_ceil(2) as usize);
        if self.levels.is_empty() {
            self.levels.push(Level::default());
        }
        if let Some(first) = self.levels.first_mut() {
            first.farthest.clear();
            first.farthest.extend(half.iter().take(width * height));
            first.resize(width, height);
        }
        self.reduce(width, height, 1, &[]);
        self.finest = Some(viewport);
    }

    /// Fills all levels from `count` on. The one before, or `image` if there is none, has this size.
    fn reduce(&mut self, mut width: usize, mut height: usize, mut count: usize, image: &[f32]) {
        while width > 1 || height > 1 {
            let (next_width, next_height) = (width.div_ceil(2), height.div_ceil(2));
            if self.levels.len() == count {
                self.levels.push(Level::default());
            }
            let (done, rest) = self.levels.split_at_mut(count);
            let Some(level) = rest.first_mut() else { break };
            let finer = done.last().map_or(image, |finer| &finer.farthest);
            level.resize(next_width, next_height);
            level.reduce(finer, width);
            (width, height) = (next_width, next_height);
            count += 1;
        }
        self.levels.truncate(count);
    }

    /// The size of the image this was built over.
    #[must_use]
    pub const fn viewport(&self) -> Option<Viewport> {
        self.finest
    }

    /// The index of the last level, which is a single texel; 0 is the image.
    #[must_use]
    pub fn last_level(&self) -> usize {
        self.levels.len()
    }

    /// The farthest depths of level `index`, row by row. `None` for the image itself and past the last level.
    #[must_use]
    pub fn farthest(&self, index: usize) -> Option<&[f32]> {
        self.levels.get(index.checked_sub(1)?).map(|level| level.farthest.as_slice())
    }

    /// Level `index`; level 0 is `image`, the one this was built over. Without one nothing hides there.
    pub(crate) fn level<'p>(&'p self, image: Option<DepthImage<'p>>, index: usize) -> Texels<'p> {
        match index.checked_sub(1).and_then(|index| self.levels.get(index)) {
            Some(level) => Texels { width: level.width, values: &level.farthest },
            None => image.map_or(Texels { width: 0, values: &[] }, |image| Texels {
                width: image.viewport().width() as usize,
                values: image.depth(),
            }),
        }
    }
}

impl Level {
    fn resize(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.farthest.resize(width * height, 0.0);
    }

    /// Fills this level from the finer one of `finer_width` columns.
    fn reduce(&mut self, finer: &[f32], finer_width: usize) {
        for (row, pair) in self.farthest.chunks_exact_mut(self.width).zip(finer.chunks(2 * finer_width)) {
            let (top, bottom) = pair.split_at(finer_width);
            // An odd picture's last row stands for itself.
            let bottom = if bottom.is_empty() { top } else { bottom };
            let (tops, top_rest) = top.as_chunks::<2>();
            let (bottoms, bottom_rest) = bottom.as_chunks::<2>();
            for ((texel, t), b) in row.iter_mut().zip(tops).zip(bottoms) {
                *texel = farther(farther(t[0], t[1]), farther(b[0], b[1]));
            }
            if let (Some(texel), [t], [b]) = (row.last_mut(), top_rest, bottom_rest) {
                *texel = farther(*t, *b);
            }
        }
    }
}

/// The smaller of two depths: a plain comparison becomes one instruction, whereas `f32::min` also handles
/// NaN.
#[inline]
fn farther(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use trimaran_scene::random::Random;

    use super::*;

    /// Every texel of every level is the farthest of exactly its pixels, at sizes that are and are not powers
    /// of two.
    #[test]
    fn each_texel_is_the_farthest_of_its_pixels() {
        let mut random = Random::new(4);
        let mut pyramid = DepthPyramid::default();
        for (width, height) in
            [(1, 1), (1, 9), (9, 1), (2, 2), (3, 5), (64, 64), (333, 77), (1023, 3), (17, 16)]
        {
            let viewport = Viewport::new(width, height).unwrap();
            let depth: Vec<f32> = (0..width * height).map(|_| random.between(0.0, 1.0) as f32).collect();
            let image = DepthImage::new(viewport, &depth).unwrap();
            pyramid.rebuild(image);
            let (width, height) = (width as usize, height as usize);
            for level in 0..=pyramid.last_level() {
                let texels = pyramid.level(Some(image), level);
                for (y, x) in
                    (0..=(height - 1) >> level).flat_map(|y| (0..=(width - 1) >> level).map(move |x| (y, x)))
                {
                    let rows = (y << level)..((y + 1) << level).min(height);
                    let columns = || (x << level)..((x + 1) << level).min(width);
                    let farthest =
                        rows.flat_map(|r| columns().map(move |c| (r, c))).map(|(r, c)| depth[r * width + c]);
                    let farthest = farthest.reduce(f32::min).unwrap();
                    assert_eq!(texels.at(x, y), farthest, "{width} x {height}, level {level}, ({x}, {y})");
                }
            }
            assert_eq!((width - 1).max(height - 1) >> pyramid.last_level(), 0, "{width} x {height}");
            let mut over_half = DepthPyramid::default();
            over_half.rebuild_over_half(viewport, pyramid.farthest(1).unwrap_or(&depth));
            assert_eq!(over_half.last_level(), pyramid.last_level().max(1));
            for level in 1..=pyramid.last_level() {
                assert_eq!(over_half.farthest(level), pyramid.farthest(level), "{width} x {height}");
            }
        }
    }

    #[test]
    fn texels_that_half_a_depth_lacks_are_background() {
        let mut pyramid = DepthPyramid::default();
        pyramid.rebuild_over_half(Viewport::new(3, 2).unwrap(), &[0.5]);
        assert_eq!([1, 2].map(|level| pyramid.farthest(level).unwrap()), [&[0.5, 0.0][..], &[0.0]]);
    }

    #[test]
    fn an_image_has_one_value_a_pixel() {
        let viewport = Viewport::new(3, 2).unwrap();
        let error = DepthImage::new(viewport, &[0.0; 5]).unwrap_err();
        assert_eq!(error.to_string(), "5 depth values for a picture of 3 x 2 pixels");
    }
}
