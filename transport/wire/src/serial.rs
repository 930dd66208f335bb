//! A numbered value, for lanes on which values may be lost, repeated or overtaken.

use crate::FixedBytes;

/// Counts the values published on a link, from 0; it wraps to 0 after the last number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Serial(pub u32);

/// A value of the latest lane and its number on the link.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Numbered {
    /// The number.
    pub number: Serial,
    /// The value's bytes.
    pub value: FixedBytes,
}

impl Serial {
    /// Whether this value was published after `other`, in serial number order (RFC 1982). Correct as long as
    /// the two are fewer than 2^31 apart.
    #[must_use]
    pub const fn is_after(self, other: Self) -> bool {
        (self.0.wrapping_sub(other.0) as i32) > 0
    }

    /// The number of the next value.
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0.wrapping_add(1))
    }
}

impl Numbered {
    /// The bytes of the number; the value's follow.
    pub const NUMBER_BYTES: usize = 4;

    /// Writes the number as u32, little-endian, and the value.
    pub fn write(&self, out: &mut impl bytes::BufMut) {
        out.put_u32_le(self.number.0);
        out.put_slice(&self.value);
    }

    /// Reads both; `None` if the size is not that of a number and a value of `size` bytes.
    #[must_use]
    pub fn read(bytes: &[u8], size: usize) -> Option<Self> {
        let (number, value) = bytes.split_first_chunk()?;
        let number = Serial(u32::from_le_bytes(*number));
        (value.len() == size).then(|| Self { number, value: value.into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_goes_on_over_the_last_number() {
        let (last, first) = (Serial(u32::MAX), Serial(0));
        assert_eq!(last.next(), first);
        assert!(first.is_after(last) && !last.is_after(first) && !first.is_after(first));
        assert!(Serial(7).is_after(Serial(5)));
    }

    #[test]
    fn the_number_comes_first() {
        let numbered = Numbered { number: Serial(0x0403_0201), value: [9, 8, 7].as_slice().into() };
        let mut bytes = Vec::new();
        numbered.write(&mut bytes);
        assert_eq!(bytes, [1, 2, 3, 4, 9, 8, 7]);
        assert_eq!(Numbered::read(&bytes, 3), Some(numbered));
        assert_eq!(Numbered::read(&bytes, 4), None);
    }
}
