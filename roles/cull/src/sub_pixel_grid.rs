//! The grid to which a rasterizer moves the corners of triangles.

/// How finely a rasterizer places corners: it moves each by up to half a step to a point of a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SubPixelGrid {
    bits: u8,
}

impl SubPixelGrid {
    /// A grid of 2^`bits` steps to a pixel, as Vulkan's `subPixelPrecisionBits` says. It demands at least 4;
    /// more than 8 count as 8, the usual ones.
    #[must_use]
    pub const fn of_bits(bits: u32) -> Self {
        Self {
            bits: match bits {
                0..=4 => 4,
                5..8 => bits as u8,
                _ => 8,
            },
        }
    }

    /// How many steps a pixel has.
    #[must_use]
    pub const fn steps(self) -> u16 {
        1 << self.bits
    }

    /// A step, in pixels.
    #[must_use]
    pub fn step_px(self) -> f64 {
        1.0 / f64::from(self.steps())
    }

    /// How far a box's outline is grown on the screen, in pixels to each side: half a pixel, so that it holds
    /// a pixel centre however small it is, and a step.
    #[must_use]
    pub fn outline_px(self) -> f64 {
        0.5 + self.step_px()
    }

    /// The allowance for the grid and for rounding, in pixels: four steps.
    #[must_use]
    pub fn margin_px(self) -> f64 {
        4.0 * self.step_px()
    }
}

impl Default for SubPixelGrid {
    /// 256 steps to a pixel.
    fn default() -> Self {
        Self::of_bits(8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_follow_the_bits_within_what_vulkan_allows() {
        let steps = [0, 4, 5, 8, 9, 32].map(|bits| SubPixelGrid::of_bits(bits).step_px().recip());
        assert_eq!(steps, [16.0, 16.0, 32.0, 256.0, 256.0, 256.0]);
        let grid = SubPixelGrid::of_bits(4);
        assert_eq!([grid.outline_px(), grid.margin_px()], [0.5625, 0.25]);
        assert_eq!(SubPixelGrid::default().margin_px(), 1.0 / 64.0);
    }
}
