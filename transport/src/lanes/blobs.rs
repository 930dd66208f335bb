//! Blobs: bytes of any length on the bulk lane, cut into blocks.
//!
//! The first byte of a block says what it is: the begin of a blob (then come its length, 8 bytes
//! little-endian, and its first bytes), more of it, or that the rest does not come.

use bytes::{Buf, BufMut, Bytes, BytesMut};
use thiserror::Error;
use trimaran_wire::MAX_BLOCK;

use super::bulk::{BulkReceiver, BulkSender};
use crate::error::{RecvError, SendError};

const BEGIN: u8 = 0;
const MORE: u8 = 1;
const CANCEL: u8 = 2;

/// Sends blobs over a bulk lane. The peer receives with a [`BlobReceiver`].
#[derive(Debug)]
pub struct BlobSender {
    blocks: BulkSender,
    /// A blob was begun and not finished.
    is_open: bool,
}

/// Receives blobs over a bulk lane.
#[derive(Debug)]
pub struct BlobReceiver {
    blocks: BulkReceiver,
    most: u64,
    open: Option<Open>,
}

/// A blob of which some has come.
#[derive(Debug)]
struct Open {
    length: u64,
    received: u64,
    /// Its bytes, unless it is too long: then they are left out.
    bytes: Option<BytesMut>,
}

/// A step of a blob on its way.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum BlobEvent {
    /// A part of it.
    Progress {
        /// The bytes so far.
        received: u64,
        /// The bytes of the whole blob.
        length: u64,
    },
    /// All of it.
    Whole(Bytes),
    /// The peer gave it up.
    Cancelled {
        /// The bytes that had come.
        received: u64,
        /// The bytes of the whole blob.
        length: u64,
    },
}

/// Why no blob was received.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BlobError {
    /// The link ended.
    #[error(transparent)]
    Link(#[from] RecvError),
    /// The blob is longer than this side takes. The next blob may be received.
    #[error("a blob of {length} bytes came, and at most {most} are taken")]
    TooLong {
        /// Its length in bytes.
        length: u64,
        /// The limit in bytes.
        most: u64,
    },
    /// A block came that is no part of a blob: the peer sends blocks of its own.
    #[error("a block came that is no part of a blob")]
    Malformed,
}

impl BulkSender {
    /// Sends blobs from now on, in place of blocks.
    #[must_use]
    pub const fn blobs(self) -> BlobSender {
        BlobSender { blocks: self, is_open: false }
    }
}

impl BulkReceiver {
    /// Receives blobs of at most `most` bytes from now on, in place of blocks.
    #[must_use]
    pub const fn blobs(self, most: u64) -> BlobReceiver {
        BlobReceiver { blocks: self, most, open: None }
    }
}

impl BlobSender {
    /// Sends a blob of any length. `progress` is told after each block how many bytes are sent.
    ///
    /// Dropping the future cancels the blob. The peer is told so before the next one.
    ///
    /// # Errors
    /// If the peer is gone, or takes nothing within the link's timeout.
    pub async fn send(&mut self, mut blob: Bytes, mut progress: impl FnMut(u64)) -> Result<(), SendError> {
        if self.is_open {
            self.blocks.send(Bytes::from_static(&[CANCEL])).await?;
            self.is_open = false;
        }
        let length = blob.len() as u64;
        loop {
            let mut block = BytesMut::with_capacity(MAX_BLOCK.min(blob.len() + 1 + size_of::<u64>()));
            if self.is_open {
                block.put_u8(MORE);
            } else {
                block.put_u8(BEGIN);
                block.put_u64_le(length);
            }
            let part = blob.split_to(blob.len().min(MAX_BLOCK - block.len()));
            block.put(part);
            self.blocks.send(block.freeze()).await?;
            self.is_open = !blob.is_empty();
            progress(length - blob.len() as u64);
            if blob.is_empty() {
                return Ok(());
            }
        }
    }

    /// The lane, for blocks again, or to [close](crate::Link::close) the link.
    #[must_use]
    pub fn into_blocks(self) -> BulkSender {
        self.blocks
    }
}

impl BlobReceiver {
    /// Waits for more of a blob, for as long as the peer lives. Bytes that have come take as much memory,
    /// and a claimed length takes none. Dropping the future loses nothing.
    ///
    /// # Errors
    /// If the link ends, a blob is too long, or the peer sends blocks that are no blobs.
    pub async fn recv(&mut self) -> Result<BlobEvent, BlobError> {
        loop {
            let mut block = self.blocks.recv().await?;
            let open = match (block.try_get_u8(), self.open.take()) {
                (Ok(BEGIN), None) => {
                    let length = block.try_get_u64_le().map_err(|_| BlobError::Malformed)?;
                    let bytes = (length <= self.most).then(BytesMut::new);
                    Open { length, received: 0, bytes }
                }
                (Ok(MORE), Some(open)) => open,
                (Ok(CANCEL), Some(Open { length, received, .. })) => {
                    return Ok(BlobEvent::Cancelled { received, length });
                }
                _ => return Err(BlobError::Malformed),
            };
            if let Some(event) = self.take(open, &block)? {
                return Ok(event);
            }
        }
    }

    /// Waits for the next whole blob, past those that the peer gave up. Dropping the future loses nothing.
    ///
    /// # Errors
    /// As [`BlobReceiver::recv`].
    pub async fn whole(&mut self) -> Result<Bytes, BlobError> {
        loop {
            if let BlobEvent::Whole(blob) = self.recv().await? {
                return Ok(blob);
            }
        }
    }

    /// Adds a part to a blob. Of one that is too long there is an error at its begin, and no event.
    fn take(&mut self, mut open: Open, part: &[u8]) -> Result<Option<BlobEvent>, BlobError> {
        let is_first = open.received == 0;
        open.received += part.len() as u64;
        let (received, length) = (open.received, open.length);
        if received > length || part.is_empty() && length > 0 {
            return Err(BlobError::Malformed);
        }
        let is_whole = received == length;
        let event = match &mut open.bytes {
            Some(bytes) => {
                bytes.extend_from_slice(part);
                let event = if is_whole {
                    BlobEvent::Whole(std::mem::take(bytes).freeze())
                } else {
                    BlobEvent::Progress { received, length }
                };
                Ok(Some(event))
            }
            None if is_first => Err(BlobError::TooLong { length, most: self.most }),
            None => Ok(None),
        };
        self.open = (!is_whole).then_some(open);
        event
    }

    /// The lane, for blocks again, or to [close](crate::Link::close) the link.
    #[must_use]
    pub fn into_blocks(self) -> BulkReceiver {
        self.blocks
    }
}
