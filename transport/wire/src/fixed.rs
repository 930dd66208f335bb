//! Values encoded in a fixed number of bytes.

use std::convert::Infallible;
use std::error::Error;

use smallvec::SmallVec;

/// A value encoded in [`Fixed::SIZE`] bytes: for the latest lane, or the header of a frame.
///
/// Both sides must agree on every byte. Little-endian is usual here. Numbers and arrays of numbers are
/// values.
pub trait Fixed: Sized + Send + Sync + 'static {
    /// The size in bytes, at most [`MAX_FIXED`].
    const SIZE: usize;

    /// The error for invalid bytes.
    type Error: Error + Send + Sync + 'static;

    /// Writes the value into `out` of [`Fixed::SIZE`] bytes.
    fn write(&self, out: &mut [u8]);

    /// Reads a value from `bytes`, [`Fixed::SIZE`] of them.
    ///
    /// # Errors
    /// If they are invalid. The peer then has broken the protocol.
    fn read(bytes: &[u8]) -> Result<Self, Self::Error>;

    /// The bytes of the value. They are [`Fixed::SIZE`], unless the size is known only at run time:
    /// [`Protocol::format`](crate::Protocol::format).
    fn to_bytes(&self) -> FixedBytes {
        let mut bytes = FixedBytes::from_elem(0, Self::SIZE);
        self.write(&mut bytes);
        bytes
    }
}

/// The most bytes of a [`Fixed`] value: with its headers it fits into one datagram of any network.
pub const MAX_FIXED: usize = 1024;

/// The bytes of a [`Fixed`] value. Up to 96 of them need no heap allocation.
pub type FixedBytes = SmallVec<[u8; 96]>;

/// The bytes of `value`.
#[must_use]
pub fn to_bytes<T: Fixed>(value: &T) -> FixedBytes {
    value.to_bytes()
}

/// No bytes: for unused lanes, and frames that begin with only their number.
impl Fixed for () {
    const SIZE: usize = 0;
    type Error = Infallible;

    fn write(&self, _: &mut [u8]) {}

    fn read(_: &[u8]) -> Result<Self, Infallible> {
        Ok(())
    }
}
