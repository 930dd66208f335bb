//! The size of a picture.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};

use crate::SettingsError;

/// A picture's size in pixels, each side 1 to 65,536.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "(u32, u32)", into = "(u32, u32)")]
pub struct Viewport {
    width: u32,
    height: u32,
}

impl Viewport {
    /// The largest size.
    pub const LARGEST: Self = Self { width: 65_536, height: 65_536 };

    /// A picture of `width` by `height` pixels.
    ///
    /// # Errors
    /// When a side is 0 or above 65,536.
    pub const fn new(width: u32, height: u32) -> Result<Self, SettingsError> {
        if width == 0 || height == 0 || width > 65_536 || height > 65_536 {
            return Err(SettingsError::Size { width, height });
        }
        Ok(Self { width, height })
    }

    /// Pixels, 1 to 65,536.
    #[must_use]
    pub const fn width(self) -> u32 {
        self.width
    }

    /// Pixels, 1 to 65,536.
    #[must_use]
    pub const fn height(self) -> u32 {
        self.height
    }

    /// Width over height.
    #[must_use]
    pub const fn aspect(self) -> f32 {
        self.width as f32 / self.height as f32
    }
}

impl TryFrom<(u32, u32)> for Viewport {
    type Error = SettingsError;

    fn try_from((width, height): (u32, u32)) -> Result<Self, SettingsError> {
        Self::new(width, height)
    }
}

impl From<Viewport> for (u32, u32) {
    fn from(size: Viewport) -> Self {
        (size.width, size.height)
    }
}

/// As `1920x1080`.
impl FromStr for Viewport {
    type Err = SettingsError;

    fn from_str(text: &str) -> Result<Self, SettingsError> {
        let sides = text.split_once('x').and_then(|(width, height)| {
            let [width, height] = [width, height].map(|side| side.parse().ok());
            width.zip(height)
        });
        let (width, height) = sides.ok_or_else(|| SettingsError::NoSize(text.to_owned()))?;
        Self::new(width, height)
    }
}

impl fmt::Display for Viewport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_is_1_to_65536_pixels() {
        assert_eq!(Viewport::new(1, 65_536).map(Into::into), Ok((1, 65_536)));
        for (width, height) in [(0, 1), (1, 0), (65_537, 1), (1, 65_537)] {
            assert_eq!(Viewport::new(width, height), Err(SettingsError::Size { width, height }));
        }
    }

    #[test]
    fn a_size_reads_back_from_its_text() {
        let size = Viewport::new(1920, 1080).unwrap();
        assert_eq!(size.to_string().parse(), Ok(size));
        for text in ["", "x", "8", "8x", "x8", "8x8x8", "-1x8", "8 x 8", "8X8"] {
            assert_eq!(text.parse::<Viewport>(), Err(SettingsError::NoSize(text.to_owned())));
        }
        assert_eq!("0x8".parse::<Viewport>(), Err(SettingsError::Size { width: 0, height: 8 }));
    }
}
