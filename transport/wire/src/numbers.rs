//! Numbers and arrays of numbers as values and items, little-endian.

use std::convert::Infallible;

use crate::{Fixed, Item};

macro_rules! numbers {
    ($($number:ty)+) => { $(
        /// Little-endian.
        impl Item for $number {
            const SIZE: usize = size_of::<Self>();

            #[inline]
            fn write(self, out: &mut [u8]) {
                if let Some(out) = out.first_chunk_mut() {
                    *out = self.to_le_bytes();
                }
            }

            #[inline]
            fn read(bytes: &[u8]) -> Self {
                bytes.first_chunk().map_or(Self::default(), |bytes| Self::from_le_bytes(*bytes))
            }
        }

        /// Little-endian, one after the other.
        impl<const N: usize> Item for [$number; N] {
            const SIZE: usize = size_of::<Self>();

            #[inline]
            fn write(self, out: &mut [u8]) {
                for (number, out) in self.into_iter().zip(out.as_chunks_mut().0) {
                    *out = number.to_le_bytes();
                }
            }

            #[inline]
            fn read(bytes: &[u8]) -> Self {
                let mut all = [<$number>::default(); N];
                for (number, bytes) in all.iter_mut().zip(bytes.as_chunks().0) {
                    *number = <$number>::from_le_bytes(*bytes);
                }
                all
            }
        }

        as_item!($number);
        as_item!([$number; N], const N: usize);
    )+ };
}

/// A value with the bytes of the same type's item.
macro_rules! as_item {
    ($type:ty $(, const $n:ident: usize)?) => {
        /// Little-endian.
        impl $(<const $n: usize>)? Fixed for $type {
            const SIZE: usize = <Self as Item>::SIZE;
            type Error = Infallible;

            fn write(&self, out: &mut [u8]) {
                Item::write(*self, out);
            }

            fn read(bytes: &[u8]) -> Result<Self, Infallible> {
                Ok(Item::read(bytes))
            }
        }
    };
}

numbers!(u8 u16 u32 u64 i8 i16 i32 i64 f32 f64);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::to_bytes;

    #[test]
    fn numbers_and_arrays_are_little_endian_values_and_items() {
        let mut bytes = [9; 4];
        Item::write([1u16, 0x203], &mut bytes);
        assert_eq!((bytes, <[u16; 2] as Item>::SIZE), ([1, 0, 3, 2], 4));
        assert_eq!(<[u16; 2] as Item>::read(&bytes), [1, 0x203]);
        assert_eq!(to_bytes(&[1.0f32, -0.5])[..], [0, 0, 0x80, 0x3f, 0, 0, 0, 0xbf]);
        assert_eq!(<[f32; 2] as Fixed>::read(&[0, 0, 0x80, 0x3f, 0, 0, 0, 0xbf]), Ok([1.0, -0.5]));
        assert_eq!(to_bytes(&-2i64)[..], [0xfe, 255, 255, 255, 255, 255, 255, 255]);
        assert_eq!((<u8 as Item>::read(&[7]), <f64 as Fixed>::SIZE), (7, 8));
        assert_eq!(<[u8; 3] as Item>::read(&[1, 2, 3]), [1, 2, 3]);
    }

    #[test]
    fn bytes_that_lack_read_as_zero() {
        assert_eq!((<u32 as Item>::read(&[1, 2]), <[u16; 2] as Item>::read(&[1, 2, 3])), (0, [0x201, 0]));
    }
}
