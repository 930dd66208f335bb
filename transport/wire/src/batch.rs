//! Items in batches, the bulk of a frame.

use std::fmt;
use std::marker::PhantomData;

use bytes::{Bytes, BytesMut};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// An item of a frame: a value of fixed size for which every bit pattern is valid. Numbers and arrays of
/// numbers are items.
///
/// Both methods are called for each item of a frame: mark them `#[inline]`.
pub trait Item: Copy + PartialEq + fmt::Debug + Send + Sync + 'static {
    /// The size in bytes, 1 to 256.
    const SIZE: usize;

    /// Writes the item into `out` of [`Item::SIZE`] bytes.
    fn write(self, out: &mut [u8]);

    /// Reads an item from `bytes`, [`Item::SIZE`] of them.
    fn read(bytes: &[u8]) -> Self;
}

/// The largest number of items in a batch: `b` in the paper's bandwidth formula (section 3.3), 1 to 16,384.
///
/// Small batches arrive sooner, large ones cost fewer headers. With items of 4 bytes the default, 256, costs
/// 0.4 % in headers and fits one Ethernet frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "u32", into = "u32")]
pub struct BatchSize(u16);

/// A batch size outside 1 to 16,384.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a batch of {0} is outside 1 to {max}", max = BatchSize::MAX.0)]
pub struct BatchSizeError(u32);

impl BatchSize {
    /// The largest batch.
    pub const MAX: Self = Self(16_384);

    /// A batch of at most `items` items.
    ///
    /// # Errors
    /// If `items` is 0 or above 16,384.
    pub const fn new(items: u32) -> Result<Self, BatchSizeError> {
        if items == 0 || items > Self::MAX.0 as u32 {
            Err(BatchSizeError(items))
        } else {
            Ok(Self(items as u16))
        }
    }

    /// The number of items.
    #[must_use]
    pub const fn items(self) -> usize {
        self.0 as usize
    }
}

impl Default for BatchSize {
    fn default() -> Self {
        Self(256)
    }
}

impl TryFrom<u32> for BatchSize {
    type Error = BatchSizeError;

    fn try_from(items: u32) -> Result<Self, BatchSizeError> {
        Self::new(items)
    }
}

impl From<BatchSize> for u32 {
    fn from(size: BatchSize) -> Self {
        Self::from(size.0)
    }
}

/// 1 to 16,384 encoded items: shared bytes, so that cloning or passing a batch on copies nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Batch<I>(Bytes, PhantomData<fn() -> I>);

/// Bytes that are not a batch of items.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{bytes} bytes are not 1 to {max} items of {item} bytes", max = BatchSize::MAX.0)]
pub struct BatchError {
    /// The number of bytes.
    pub bytes: usize,
    /// The bytes of an item.
    pub item: usize,
}

impl<I: Item> Batch<I> {
    /// Takes bytes that hold items.
    ///
    /// # Errors
    /// If there are none, too many, or a part of one.
    pub fn new(bytes: Bytes) -> Result<Self, BatchError> {
        Self::of(bytes, I::SIZE)
    }

    /// The same where an item on the wire has `item` bytes, a multiple of [`Item::SIZE`].
    ///
    /// # Errors
    /// If there are none, too many, or a part of one.
    pub fn of(bytes: Bytes, item: usize) -> Result<Self, BatchError> {
        check(bytes.len(), item)?;
        Ok(Self(bytes, PhantomData))
    }

    /// The number of items, at least 1.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.len() / I::SIZE
    }

    /// The items in the order in which they were pushed.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = I> + '_ {
        self.0.chunks_exact(I::SIZE).map(I::read)
    }

    /// The encoded items.
    #[must_use]
    pub const fn as_bytes(&self) -> &Bytes {
        &self.0
    }
}

/// Whether so many bytes can be a batch of items of `item` bytes.
pub(crate) fn check(bytes: usize, item: usize) -> Result<(), BatchError> {
    let sound = bytes > 0 && bytes <= BatchSize::MAX.items() * item && bytes.is_multiple_of(item);
    if sound { Ok(()) } else { Err(BatchError { bytes, item }) }
}

/// Appends encoded `items`.
pub(crate) fn put_items<I: Item>(out: &mut BytesMut, items: &[I]) {
    let start = out.len();
    out.resize(start + items.len() * I::SIZE, 0);
    for (slot, item) in out[start..].chunks_exact_mut(I::SIZE).zip(items) {
        item.write(slot);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batch_sizes_end_at_16384() {
        assert_eq!(BatchSize::new(1).map(BatchSize::items), Ok(1));
        assert_eq!(BatchSize::new(16_384), Ok(BatchSize::MAX));
        assert_eq!(BatchSize::new(0), Err(BatchSizeError(0)));
        assert_eq!(BatchSize::new(16_385), Err(BatchSizeError(16_385)));
        assert_eq!(BatchSize::new(65_537), Err(BatchSizeError(65_537)), "no wrap to 1");
        assert_eq!(BatchSizeError(0).to_string(), "a batch of 0 is outside 1 to 16384");
    }

    #[test]
    fn numbers_are_little_endian() {
        let mut out = BytesMut::new();
        put_items(&mut out, &[1_u32, 0x0403_0201]);
        assert_eq!(&out[..], [1, 0, 0, 0, 1, 2, 3, 4]);
        let batch = Batch::<u32>::new(out.freeze()).unwrap();
        assert_eq!(batch.count(), 2);
        assert_eq!(batch.iter().collect::<Vec<_>>(), [1, 0x0403_0201]);
    }

    #[test]
    fn a_batch_is_whole_items_and_at_least_one() {
        for bytes in [0, 1, 3, 5, 65_537, 65_540] {
            let refused = Batch::<u32>::new(Bytes::from(vec![0; bytes]));
            assert_eq!(refused, Err(BatchError { bytes, item: 4 }));
        }
        assert_eq!(Batch::<u32>::new(Bytes::from(vec![0; 65_536])).unwrap().count(), 16_384);
    }
}
