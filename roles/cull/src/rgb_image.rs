//! Pictures in files: PNG to and from memory.

use std::io::{self, Cursor, ErrorKind};

use crate::Image;

/// An 8-bit RGB image in memory, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RgbImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green and blue, sRGB-encoded.
    pub pixels: Vec<[u8; 3]>,
}

impl RgbImage {
    /// The colours of a picture; `None` if its bytes do not fill its size, or it has no pixel.
    pub fn of(picture: &Image) -> Option<Self> {
        let (pixels, _) = picture.rgba.as_chunks();
        let Image { width, height, .. } = *picture;
        let is_whole = !pixels.is_empty() && pixels.len() as u64 == u64::from(width) * u64::from(height);
        let pixels = pixels.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
        is_whole.then_some(Self { width, height, pixels })
    }

    /// The bytes of a PNG file.
    ///
    /// # Errors
    ///
    /// `pixels` do not fill the size, or it has no pixel.
    pub fn encode(&self, compression: png::Compression) -> Result<Vec<u8>, png::EncodingError> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(compression);
        encoder.write_header()?.write_image_data(self.pixels.as_flattened())?;
        Ok(file)
    }

    /// Reads back the output of [`Self::encode`].
    ///
    /// # Errors
    ///
    /// It is not such a file, or does not fit into memory.
    pub fn decode(file: &[u8]) -> Result<Self, png::DecodingError> {
        let mut reader = png::Decoder::new(Cursor::new(file)).read_info()?;
        let refused = |kind: ErrorKind, why: &str| png::DecodingError::from(io::Error::new(kind, why));
        if reader.output_color_type() != (png::ColorType::Rgb, png::BitDepth::Eight) {
            return Err(refused(ErrorKind::InvalidData, "the picture is not of 8-bit red, green and blue"));
        }
        let (width, height) = reader.info().size();
        let count = (width as usize).saturating_mul(height as usize);
        let mut pixels = Vec::new();
        if pixels.try_reserve_exact(count).is_err() {
            return Err(refused(ErrorKind::OutOfMemory, "the picture does not fit into memory"));
        }
        pixels.resize(count, [0; 3]);
        reader.next_frame(pixels.as_flattened_mut())?;
        Ok(Self { width, height, pixels })
    }

    /// The image made smaller by an integer factor. `of_block` makes one pixel of a block's.
    pub fn shrink(&self, factor: u32, of_block: impl Fn(&[[u8; 3]]) -> [u8; 3]) -> Self {
        let (width, height) = (self.width.div_ceil(factor), self.height.div_ceil(factor));
        let mut block = Vec::with_capacity((factor * factor) as usize);
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            for x in 0..width {
                block.clear();
                for row in y * factor..((y + 1) * factor).min(self.height) {
                    let start = row as usize * self.width as usize;
                    let (left, right) = (x * factor, ((x + 1) * factor).min(self.width));
                    block.extend_from_slice(&self.pixels[start + left as usize..start + right as usize]);
                }
                pixels.push(of_block(&block));
            }
        }
        Self { width, height, pixels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_survives_its_file_and_loses_alpha() {
        let rgba: Vec<u8> = (0..5 * 3 * 4).collect();
        let picture = Image { width: 5, height: 3, rgba };
        assert_eq!(RgbImage::of(&Image { height: 4, ..picture.clone() }), None);
        let rgb = RgbImage::of(&picture).unwrap();
        assert_eq!(rgb.pixels[1], [4, 5, 6]);
        for compression in [png::Compression::Fast, png::Compression::Balanced] {
            assert_eq!(RgbImage::decode(&rgb.encode(compression).unwrap()).unwrap(), rgb);
        }
    }

    #[test]
    fn another_kind_of_picture_and_one_beyond_memory_are_refused() {
        let file = |colour, [width, height]: [u32; 2]| {
            let mut file = Vec::new();
            let mut encoder = png::Encoder::new(&mut file, width, height);
            encoder.set_color(colour);
            // Its pixels are lacking.
            encoder.write_header().unwrap().write_chunk(png::chunk::IDAT, &[]).unwrap();
            file
        };
        let refused = |file: Vec<u8>| RgbImage::decode(&file).unwrap_err().to_string();
        let grey = refused(file(png::ColorType::Grayscale, [4, 4]));
        assert!(grey.contains("8-bit red, green and blue"), "{grey}");
        let huge = refused(file(png::ColorType::Rgb, [0x7fff_ffff; 2]));
        assert!(huge.contains("memory") || huge.contains("imit"), "{huge}");
    }

    #[test]
    fn shrinking_takes_every_pixel_once_at_odd_sizes() {
        let rgb = RgbImage { width: 5, height: 3, pixels: (0..15).map(|place| [place, 0, 0]).collect() };
        let small = rgb.shrink(2, |block| [block.len() as u8, block.iter().map(|pixel| pixel[0]).sum(), 0]);
        assert_eq!((small.width, small.height), (3, 2));
        let (upper, lower) = ([[4, 12, 0], [4, 20, 0], [2, 13, 0]], [[2, 21, 0], [2, 25, 0], [1, 14, 0]]);
        assert_eq!(small.pixels, [upper, lower].concat());
    }
}
