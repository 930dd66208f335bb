//! Pictures of a display.

/// A colour image: sRGB-encoded red, green, blue and alpha (255), 8 bits each, row by row from the top.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Four bytes a pixel.
    pub rgba: Vec<u8>,
}
