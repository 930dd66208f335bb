//! Big-endian numbers and strings out of bytes, with the place of whatever is missing.

use super::RvmError;

/// Reads forward through bytes that start at `base` in the file.
#[derive(Clone)]
pub(super) struct Reader<'a> {
    rest: &'a [u8],
    offset: usize,
}

impl<'a> Reader<'a> {
    pub(super) const fn new(file: &'a [u8]) -> Self {
        Self { rest: file, offset: 0 }
    }

    /// Where the next byte stands in the file.
    pub(super) const fn offset(&self) -> usize {
        self.offset
    }

    /// Splits off a reader of the bytes up to `end` in the file, and goes on behind them.
    pub(super) fn split_until(&mut self, end: usize, what: &'static str) -> Result<Self, RvmError> {
        let offset = self.offset;
        let length = end.checked_sub(offset).ok_or(RvmError::Malformed {
            offset,
            what: "a chunk says that the next one begins before its own end",
        })?;
        let rest = self.take(length, what)?;
        Ok(Self { rest, offset })
    }

    pub(super) fn take(&mut self, length: usize, what: &'static str) -> Result<&'a [u8], RvmError> {
        let (taken, rest) = self
            .rest
            .split_at_checked(length)
            .ok_or(RvmError::Truncated { offset: self.offset + self.rest.len(), what })?;
        self.rest = rest;
        self.offset += length;
        Ok(taken)
    }

    pub(super) fn u32(&mut self, what: &'static str) -> Result<u32, RvmError> {
        let offset = self.offset + self.rest.len();
        let (four, _) = self.rest.split_first_chunk().ok_or(RvmError::Truncated { offset, what })?;
        let value = u32::from_be_bytes(*four);
        self.take(4, what)?;
        Ok(value)
    }

    /// A 32-bit float as f64; it may be infinite or not a number.
    pub(super) fn float(&mut self, what: &'static str) -> Result<f64, RvmError> {
        Ok(f64::from(f32::from_bits(self.u32(what)?)))
    }

    pub(super) fn floats<const N: usize>(&mut self, what: &'static str) -> Result<[f64; N], RvmError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.float(what)?;
        }
        Ok(values)
    }

    /// A string: its length in words of four bytes, then the bytes, padded with zeros. UTF-8, or else
    /// Latin-1, which older writers use without saying so.
    pub(super) fn string(&mut self, what: &'static str) -> Result<String, RvmError> {
        let words = self.u32(what)? as usize;
        let bytes = self.take(words.saturating_mul(4), what)?;
        let bytes = bytes.split(|&byte| byte == 0).next().unwrap_or_default();
        Ok(match std::str::from_utf8(bytes) {
            Ok(text) => text.to_owned(),
            Err(_) => bytes.iter().copied().map(char::from).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_strings() {
        let bytes = b"\0\0\x01\x02\x3f\x80\0\0\0\0\0\x02caf\xe9\0\0\0\0rest";
        let mut reader = Reader::new(bytes);
        assert_eq!(reader.u32("a"), Ok(0x102));
        assert_eq!(reader.float("b"), Ok(1.0));
        assert_eq!(reader.string("c").unwrap(), "caf\u{e9}");
        assert_eq!(reader.offset(), 20);
    }

    #[test]
    fn the_end_is_told_with_its_place() {
        let mut reader = Reader::new(&[0, 0, 0]);
        assert_eq!(reader.u32("x"), Err(RvmError::Truncated { offset: 3, what: "x" }));
        let mut reader = Reader::new(&[0xff; 8]);
        assert_eq!(reader.string("name"), Err(RvmError::Truncated { offset: 8, what: "name" }));
    }

    #[test]
    fn a_chunk_cannot_end_before_it_begins() {
        let mut reader = Reader::new(&[0; 8]);
        reader.take(4, "x").unwrap();
        assert!(matches!(reader.split_until(3, "x"), Err(RvmError::Malformed { offset: 4, .. })));
        assert!(matches!(reader.split_until(9, "x"), Err(RvmError::Truncated { offset: 8, .. })));
    }
}
