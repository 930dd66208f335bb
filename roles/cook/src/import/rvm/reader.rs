//! Reads big-endian numbers and strings from a chunk's bytes.

use super::shape::{Broken, Numbers};

/// Reads forward through bytes. Missing items consume none.
#[derive(Debug)]
pub(super) struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    pub(super) const fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    pub(super) fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        self.0.split_off(..length)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.take(4)?.first_chunk().copied().map(u32::from_be_bytes)
    }

    /// A string: its length in words of four bytes, then the bytes, padded with zeros.
    pub(super) fn string(&mut self) -> Option<&'a [u8]> {
        let words = self.u32()? as usize;
        Some(until_zero(self.take(words.saturating_mul(4))?))
    }

    /// The rest, up to a zero.
    pub(super) fn rest(&self) -> &'a [u8] {
        until_zero(self.0)
    }
}

fn until_zero(bytes: &[u8]) -> &[u8] {
    bytes.split(|&byte| byte == 0).next().unwrap_or_default()
}

impl Numbers for Reader<'_> {
    fn count(&mut self) -> Result<u32, Broken> {
        self.u32().ok_or(Broken::Short)
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
        let mut reader = Reader::new(bytes);
        assert_eq!(reader.u32(), Some(0x102));
        assert_eq!(reader.real(), Ok(1.0));
        assert_eq!(reader.string(), Some(&b"caf\xe9"[..]));
        assert_eq!((reader.take(9), reader.take(4)), (None, Some(&b"rest"[..])));
    }

    #[test]
    fn what_is_not_there_is_told() {
        assert_eq!(Reader::new(&[0, 0, 0]).u32(), None);
        assert_eq!(Reader::new(&[0; 3]).real(), Err(Broken::Short));
        let mut reader = Reader::new(b"\0\0\x01\0/A\0\0");
        assert_eq!((reader.string(), reader.rest()), (None, &b"/A"[..]));
    }
}
