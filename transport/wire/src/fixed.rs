//! Values that travel in a fixed number of bytes.

use std::convert::Infallible;
use std::error::Error;

use smallvec::SmallVec;

/// A value that travels in [`Fixed::SIZE`] bytes: what a latest lane holds, or what a frame begins with.
///
/// Both sides must agree on every byte. Little-endian is the custom here.
pub trait Fixed: Sized + Send + Sync + 'static {
    /// How many bytes, at most [`MAX_FIXED`].
    const SIZE: usize;

    /// What is wrong with bytes that are no such value.
    type Error: Error + Send + Sync + 'static;

    /// Writes the value into `out`, which has [`Fixed::SIZE`] bytes.
    fn write(&self, out: &mut [u8]);

    /// Reads a value from `bytes`, which are [`Fixed::SIZE`].
    ///
    /// # Errors
    /// When they are no such value. The peer then counts as one that breaks the protocol.
    fn read(bytes: &[u8]) -> Result<Self, Self::Error>;
}

/// The most bytes of a [`Fixed`] value: with its headers it fits into one datagram of any network.
pub const MAX_FIXED: usize = 1024;

/// The bytes of a [`Fixed`] value. Up to 96 of them take no memory from the heap.
pub type FixedBytes = SmallVec<[u8; 96]>;

/// The bytes of `value`.
#[must_use]
pub fn to_bytes<T: Fixed>(value: &T) -> FixedBytes {
    let mut bytes = FixedBytes::from_elem(0, T::SIZE);
    value.write(&mut bytes);
    bytes
}

/// Nothing: for lanes that are not used, and frames that begin with their number only.
impl Fixed for () {
    const SIZE: usize = 0;
    type Error = Infallible;

    fn write(&self, _: &mut [u8]) {}

    fn read(_: &[u8]) -> Result<Self, Infallible> {
        Ok(())
    }
}
