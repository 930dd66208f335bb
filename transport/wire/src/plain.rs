//! Values and items whose bytes in memory are those on the wire.

use thiserror::Error;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{Fixed, Item};

/// A value or an item without a codec: a type of fixed layout, by the crate `zerocopy`.
///
/// Every bit pattern has to be valid, and the bytes are those of memory: take the numbers of
/// `zerocopy::little_endian`, which are the same on every machine.
///
/// ```
/// use trimaran_wire::{Fixed, Plain, to_bytes};
/// use zerocopy::{FromBytes, Immutable, IntoBytes, little_endian::F32};
///
/// #[derive(Debug, Clone, Copy, PartialEq, FromBytes, IntoBytes, Immutable)]
/// #[repr(C)]
/// struct Point {
///     x: F32,
///     y: F32,
/// }
///
/// let bytes = to_bytes(&Plain(Point { x: 1.0.into(), y: 0.5.into() }));
/// assert_eq!(bytes[..], [0, 0, 0x80, 0x3f, 0, 0, 0, 0x3f]);
/// assert_eq!(Plain::<Point>::read(&bytes).unwrap().0.y, 0.5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plain<T>(pub T);

/// The bytes are too few or too many for the type.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{came} bytes came for a value of {size}")]
pub struct PlainError {
    /// How many came.
    pub came: usize,
    /// How many the type has.
    pub size: usize,
}

impl<T: FromBytes + IntoBytes + Immutable + Send + Sync + 'static> Fixed for Plain<T> {
    const SIZE: usize = size_of::<T>();
    type Error = PlainError;

    fn write(&self, out: &mut [u8]) {
        put(&self.0, out);
    }

    fn read(bytes: &[u8]) -> Result<Self, PlainError> {
        let wrong = |_| PlainError { came: bytes.len(), size: size_of::<T>() };
        T::read_from_bytes(bytes).map(Self).map_err(wrong)
    }
}

impl<T> Item for Plain<T>
where
    T: FromBytes + IntoBytes + Immutable + Copy + PartialEq + std::fmt::Debug + Send + Sync + 'static,
{
    const SIZE: usize = size_of::<T>();

    #[inline]
    fn write(self, out: &mut [u8]) {
        put(&self.0, out);
    }

    #[inline]
    fn read(bytes: &[u8]) -> Self {
        Self(T::read_from_bytes(bytes).unwrap_or_else(|_| T::new_zeroed()))
    }
}

#[inline]
fn put<T: IntoBytes + Immutable>(value: &T, out: &mut [u8]) {
    for (out, byte) in out.iter_mut().zip(value.as_bytes()) {
        *out = *byte;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use zerocopy::little_endian::{F32, U16};

    use super::*;
    use crate::to_bytes;

    #[derive(Debug, Clone, Copy, PartialEq, FromBytes, IntoBytes, Immutable)]
    #[repr(C)]
    struct Return {
        at: [F32; 3],
        intensity: U16,
        ring: u8,
        flags: u8,
    }

    proptest! {
        #[test]
        fn any_bytes_of_the_size_are_a_value_that_writes_them(bytes in any::<[u8; 16]>()) {
            let value = <Plain<Return> as Fixed>::read(&bytes).unwrap();
            prop_assert_eq!(&to_bytes(&value)[..], &bytes);
            prop_assert_eq!(value.0.intensity.get(), u16::from_le_bytes([bytes[12], bytes[13]]));
            let item = <Plain<Return> as Item>::read(&bytes);
            let mut written = [0; 16];
            Item::write(item, &mut written);
            prop_assert_eq!(written, bytes);
        }
    }

    #[test]
    fn bytes_of_another_number_are_no_value() {
        for came in [0, 15, 17] {
            let read = <Plain<Return> as Fixed>::read(&vec![0; came]);
            assert_eq!(read, Err(PlainError { came, size: 16 }));
        }
    }
}
