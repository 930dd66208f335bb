//! Node ids in batches: what a frame mostly consists of.

use bytes::{Bytes, BytesMut};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::DrawableId;

/// The bytes of one id on the wire: a `u32`, little-endian, never a varint, so that the bandwidth formula
/// counts what travels.
pub const ID_BYTES: usize = 4;

/// How many ids travel in one batch at most: `b` in the paper's bandwidth formula (section 3.3), 1 to 16,384.
///
/// Small batches arrive sooner, large ones cost fewer headers. The default, 256, costs 0.4 % in headers and
/// fits one Ethernet frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "u32", into = "u32")]
pub struct BatchSize(u16);

/// A batch size outside 1 to 16,384.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a batch of {0} ids is outside 1 to {max}", max = BatchSize::MAX.0)]
pub struct BatchSizeError(u32);

impl BatchSize {
    /// The largest batch: 64 KiB of ids.
    pub const MAX: Self = Self(16_384);

    /// A batch of at most `ids` ids.
    ///
    /// # Errors
    /// When `ids` is 0 or above 16,384.
    pub const fn new(ids: u32) -> Result<Self, BatchSizeError> {
        if ids == 0 || ids > Self::MAX.0 as u32 { Err(BatchSizeError(ids)) } else { Ok(Self(ids as u16)) }
    }

    /// The number of ids.
    #[must_use]
    pub const fn ids(self) -> usize {
        self.0 as usize
    }

    /// The number of bytes of a full batch, header not counted.
    #[must_use]
    pub const fn bytes(self) -> usize {
        self.ids() * ID_BYTES
    }
}

impl Default for BatchSize {
    fn default() -> Self {
        Self(256)
    }
}

impl TryFrom<u32> for BatchSize {
    type Error = BatchSizeError;

    fn try_from(ids: u32) -> Result<Self, BatchSizeError> {
        Self::new(ids)
    }
}

impl From<BatchSize> for u32 {
    fn from(size: BatchSize) -> Self {
        Self::from(size.0)
    }
}

/// 1 to 16,384 ids as they travel: shared bytes, so that cloning or passing a batch on copies nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct IdBatch(Bytes);

/// Bytes that are no batch of ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{bytes} bytes are not 1 to {max} ids of {ID_BYTES} bytes", max = BatchSize::MAX.0)]
pub struct IdBatchError {
    /// How many bytes there were.
    pub bytes: usize,
}

impl IdBatch {
    /// Takes bytes that hold little-endian `u32` ids.
    ///
    /// # Errors
    /// When there are none, too many, or a part of one.
    pub fn new(bytes: Bytes) -> Result<Self, IdBatchError> {
        let whole = bytes.len().is_multiple_of(ID_BYTES);
        if bytes.is_empty() || bytes.len() > BatchSize::MAX.bytes() || !whole {
            return Err(IdBatchError { bytes: bytes.len() });
        }
        Ok(Self(bytes))
    }

    /// The number of ids, at least 1.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.len() / ID_BYTES
    }

    /// The ids in the order in which they were pushed.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = DrawableId> + '_ {
        self.0.as_chunks::<ID_BYTES>().0.iter().map(|id| DrawableId(u32::from_le_bytes(*id)))
    }

    /// The ids as they travel.
    #[must_use]
    pub const fn as_bytes(&self) -> &Bytes {
        &self.0
    }
}

/// Appends `ids` as they travel.
pub(crate) fn put_ids(out: &mut BytesMut, ids: &[DrawableId]) {
    let start = out.len();
    out.resize(start + ids.len() * ID_BYTES, 0);
    for (slot, id) in out[start..].as_chunks_mut::<ID_BYTES>().0.iter_mut().zip(ids) {
        *slot = id.0.to_le_bytes();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batch_sizes_end_at_16384() {
        assert_eq!(BatchSize::new(1).map(BatchSize::bytes), Ok(4));
        assert_eq!(BatchSize::new(16_384), Ok(BatchSize::MAX));
        assert_eq!(BatchSize::new(0), Err(BatchSizeError(0)));
        assert_eq!(BatchSize::new(16_385), Err(BatchSizeError(16_385)));
        assert_eq!(BatchSize::new(65_537), Err(BatchSizeError(65_537)), "no wrap to 1");
        assert_eq!(BatchSizeError(0).to_string(), "a batch of 0 ids is outside 1 to 16384");
    }

    #[test]
    fn ids_are_little_endian() {
        let mut out = BytesMut::new();
        put_ids(&mut out, &[DrawableId(1), DrawableId(0x0403_0201)]);
        assert_eq!(&out[..], [1, 0, 0, 0, 1, 2, 3, 4]);
        let batch = IdBatch::new(out.freeze()).unwrap();
        assert_eq!(batch.count(), 2);
        assert_eq!(batch.iter().collect::<Vec<_>>(), [DrawableId(1), DrawableId(0x0403_0201)]);
    }

    #[test]
    fn a_batch_is_whole_ids_and_at_least_one() {
        for bytes in [0, 1, 3, 5, 65_537, 65_540] {
            assert_eq!(IdBatch::new(Bytes::from(vec![0; bytes])), Err(IdBatchError { bytes }));
        }
        assert_eq!(IdBatch::new(Bytes::from(vec![0; 65_536])).unwrap().count(), 16_384);
    }
}
