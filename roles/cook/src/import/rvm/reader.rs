//! Big-endian numbers and strings out of a chunk's bytes, with the place of whatever is missing.

use super::shape::{Broken, Numbers};
use super::{RvmError, RvmPlace};

/// Reads forward through bytes of a file.
#[derive(Debug)]
pub(super) struct Reader<'a> {
    rest: &'a [u8],
    /// Where the first of `rest` stands in the file.
    offset: u64,
}

impl<'a> Reader<'a> {
    /// Reads `bytes`, which stand at `offset` in the file.
    pub(super) const fn new(bytes: &'a [u8], offset: u64) -> Self {
        Self { rest: bytes, offset }
    }

    pub(super) fn take(&mut self, length: usize, what: &'static str) -> Result<&'a [u8], RvmError> {
        let (taken, rest) = self.rest.split_at_checked(length).ok_or_else(|| self.cut(what))?;
        self.rest = rest;
        self.offset += length as u64;
        Ok(taken)
    }

    pub(super) fn u32(&mut self, what: &'static str) -> Result<u32, RvmError> {
        let four = self.rest.first_chunk().copied().ok_or_else(|| self.cut(what))?;
        self.take(4, what)?;
        Ok(u32::from_be_bytes(four))
    }

    /// A string: its length in words of four bytes, then the bytes, padded with zeros.
    pub(super) fn string(&mut self, what: &'static str) -> Result<&'a [u8], RvmError> {
        let words = self.u32(what)? as usize;
        let bytes = self.take(words.saturating_mul(4), what)?;
        Ok(bytes.split(|&byte| byte == 0).next().unwrap_or_default())
    }

    const fn cut(&self, what: &'static str) -> RvmError {
        RvmError::Truncated { at: RvmPlace::Byte(self.offset + self.rest.len() as u64), what }
    }
}

impl Numbers for Reader<'_> {
    fn count(&mut self) -> Result<u32, Broken> {
        self.u32("a primitive").map_err(|_| Broken::Short)
    }

    /// A 32-bit float as f64.
    fn real(&mut self) -> Result<f64, Broken> {
        Ok(f64::from(f32::from_bits(self.count()?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_strings() {
        let bytes = b"\0\0\x01\x02\x3f\x80\0\0\0\0\0\x02caf\xe9\0\0\0\0rest";
        let mut reader = Reader::new(bytes, 0);
        assert_eq!(reader.u32("a").unwrap(), 0x102);
        assert_eq!(reader.real(), Ok(1.0));
        assert_eq!(reader.string("c").unwrap(), b"caf\xe9");
        assert_eq!(reader.take(9, "d").unwrap_err().to_string(), told(24, "d"));
    }

    #[test]
    fn the_end_is_told_with_its_place() {
        assert_eq!(Reader::new(&[0, 0, 0], 100).u32("x").unwrap_err().to_string(), told(103, "x"));
        let mut reader = Reader::new(&[0xff; 8], 0);
        assert_eq!(reader.string("name").unwrap_err().to_string(), told(8, "name"));
        assert_eq!(Reader::new(&[0; 3], 0).real(), Err(Broken::Short));
    }

    fn told(byte: u64, what: &'static str) -> String {
        RvmError::Truncated { at: RvmPlace::Byte(byte), what }.to_string()
    }
}
