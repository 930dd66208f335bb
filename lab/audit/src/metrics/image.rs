//! Borrowed images for comparison, checked once.

use thiserror::Error;
use trimaran_cull::Image;

/// Why images cannot be measured.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum MetricError {
    /// An image's data does not fill its size, or a side is 0.
    #[error(
        "an image of {width} x {height} pixels has data for {values} whole pixels; it needs one value for each, and a pixel at least"
    )]
    Size {
        /// The width claimed.
        width: u32,
        /// The height claimed.
        height: u32,
        /// The pixels that the data holds.
        values: usize,
    },
    /// Two images of different sizes were compared.
    #[error("an image of {}x{} pixels cannot be compared with one of {}x{}", left.0, left.1, right.0, right.1)]
    Differ {
        /// Width and height of the first.
        left: (u32, u32),
        /// Width and height of the second.
        right: (u32, u32),
    },
}

/// A colour image, borrowed: 8-bit red, green, blue, alpha a pixel, row-major from the top left.
#[derive(Debug, Clone, Copy)]
pub struct ImageRef<'a> {
    size: (u32, u32),
    pixels: &'a [[u8; 4]],
}

/// An ID buffer, borrowed: the owner of each pixel, or `background`.
#[derive(Debug, Clone, Copy)]
pub struct IdBufferRef<'a> {
    size: (u32, u32),
    ids: &'a [u32],
    background: u32,
}

/// A mask of covered pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    size: (u32, u32),
    covered: Vec<bool>,
}

impl<'a> ImageRef<'a> {
    /// An image of `width` x `height` pixels, four bytes each.
    ///
    /// # Errors
    /// If `rgba` does not fill that size exactly, or a side is 0.
    pub fn new(width: u32, height: u32, rgba: &'a [u8]) -> Result<Self, MetricError> {
        let (pixels, rest) = rgba.as_chunks();
        if !rest.is_empty() {
            return Err(MetricError::Size { width, height, values: pixels.len() });
        }
        Ok(Self { size: checked(width, height, pixels.len())?, pixels })
    }

    /// All of `image`.
    ///
    /// # Errors
    /// If its bytes do not fill its size exactly, or a side is 0.
    pub fn of(image: &'a Image) -> Result<Self, MetricError> {
        Self::new(image.width, image.height, &image.rgba)
    }

    /// Width and height.
    #[must_use]
    pub const fn size(&self) -> (u32, u32) {
        self.size
    }

    /// The pixels, row by row from the top left.
    #[must_use]
    pub const fn pixels(&self) -> &'a [[u8; 4]] {
        self.pixels
    }
}

impl<'a> IdBufferRef<'a> {
    /// An ID buffer of `width` x `height` pixels; pixels without an owner hold `background`.
    ///
    /// # Errors
    /// If `ids` does not fill that size exactly, or a side is 0.
    pub fn new(width: u32, height: u32, ids: &'a [u32], background: u32) -> Result<Self, MetricError> {
        Ok(Self { size: checked(width, height, ids.len())?, ids, background })
    }

    /// Width and height.
    #[must_use]
    pub const fn size(&self) -> (u32, u32) {
        self.size
    }

    /// The owner of each pixel, row by row from the top left; `None` for the background.
    pub fn owners(&self) -> impl ExactSizeIterator<Item = Option<u32>> + '_ {
        self.ids.iter().map(|&id| (id != self.background).then_some(id))
    }

    /// The pixels with an owner.
    #[must_use]
    pub fn coverage(&self) -> Mask {
        Mask { size: self.size, covered: self.owners().map(|owner| owner.is_some()).collect() }
    }
}

impl Mask {
    /// A mask of `width` x `height` pixels, row by row from the top left.
    ///
    /// # Errors
    /// If `covered` does not fill that size exactly, or a side is 0.
    pub fn new(width: u32, height: u32, covered: Vec<bool>) -> Result<Self, MetricError> {
        Ok(Self { size: checked(width, height, covered.len())?, covered })
    }

    /// Width and height.
    #[must_use]
    pub const fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Whether each pixel is covered, row by row from the top left.
    #[must_use]
    pub fn covered(&self) -> &[bool] {
        &self.covered
    }

    pub(super) fn width(&self) -> usize {
        self.size.0 as usize
    }

    pub(super) fn height(&self) -> usize {
        self.size.1 as usize
    }

    /// The length of the picture's diagonal, which no distance in it exceeds, in pixels.
    pub(super) fn diagonal(&self) -> f64 {
        f64::from(self.size.0).hypot(f64::from(self.size.1))
    }
}

/// Refuses images of different sizes.
pub(super) fn same_size(left: (u32, u32), right: (u32, u32)) -> Result<(), MetricError> {
    if left == right { Ok(()) } else { Err(MetricError::Differ { left, right }) }
}

fn checked(width: u32, height: u32, values: usize) -> Result<(u32, u32), MetricError> {
    let fits = u64::from(width) * u64::from(height) == values as u64 && values > 0;
    if fits { Ok((width, height)) } else { Err(MetricError::Size { width, height, values }) }
}

/// A mask drawn in characters, `#` for covered pixels, rows one after the other; white space is ignored.
#[cfg(test)]
pub(super) fn mask(width: u32, rows: &str) -> Mask {
    let covered: Vec<bool> = rows.chars().filter(|c| !c.is_whitespace()).map(|c| c == '#').collect();
    let size = (width, covered.len() as u32 / width);
    Mask { size, covered }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_must_fill_the_size_exactly() {
        assert!(ImageRef::new(2, 1, &[0; 8]).is_ok());
        for bytes in [0, 4, 7, 9, 12] {
            assert!(ImageRef::new(2, 1, &vec![0; bytes]).is_err(), "{bytes} bytes");
        }
        assert!(IdBufferRef::new(0, 5, &[], 0).is_err());
        assert!(Mask::new(2, 2, vec![true; 3]).is_err());
        // A size whose product overflows 32 bits is not mistaken for a small one.
        assert!(IdBufferRef::new(1 << 16, 1 << 16, &[], 0).is_err());
    }

    #[test]
    fn the_background_covers_nothing() {
        let image = IdBufferRef::new(3, 1, &[7, u32::MAX, 0], u32::MAX).unwrap();
        assert_eq!(image.owners().collect::<Vec<_>>(), [Some(7), None, Some(0)]);
        assert_eq!(image.coverage().covered(), [true, false, true]);
    }
}
