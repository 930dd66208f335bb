//! A frame of items, turned into messages.

use std::marker::PhantomData;

use bytes::BytesMut;
use thiserror::Error;

use super::{Digest, FrameEnd, FrameMessage};
use crate::batch::put_items;
use crate::{BatchSize, FrameNumber, Item};

/// Turns begin, pushed items and finish into messages: items are gathered into batches of `b`.
///
/// It passes each message to the `emit` of the call that completed it.
#[derive(Debug)]
pub struct FrameWriter<I> {
    batch: BatchSize,
    /// Bytes of an item on the wire.
    item: usize,
    most: u32,
    pending: BytesMut,
    open: Option<Digest>,
    last: Option<FrameNumber>,
    items: PhantomData<fn(I)>,
}

/// The size of an allocation; small batches share one, so that few of them allocate.
const ROOM: usize = 16 * 1024;

impl<I: Item> FrameWriter<I> {
    /// A writer of batches of at most `batch` items.
    #[must_use]
    pub fn new(batch: BatchSize) -> Self {
        const { assert!(I::SIZE > 0, "an item has at least one byte") }
        let pending = BytesMut::new();
        Self { batch, item: I::SIZE, most: u32::MAX, pending, open: None, last: None, items: PhantomData }
    }

    /// The same for frames of at most `most` items.
    #[must_use]
    pub fn of_at_most(mut self, most: u32) -> Self {
        self.most = most;
        self
    }

    /// The same where an item on the wire has `bytes`, a multiple of [`Item::SIZE`] above 0.
    #[must_use]
    pub fn of_items(mut self, bytes: usize) -> Self {
        self.item = bytes.max(I::SIZE);
        self
    }

    /// Begins a frame.
    ///
    /// # Errors
    /// If one is open, or `frame` is not above the frame before.
    pub fn begin(&mut self, frame: FrameNumber) -> Result<(), FrameOrderError> {
        let wanted = frame;
        if let Some(digest) = &self.open {
            return Err(FrameOrderError::StillOpen { open: digest.frame, wanted });
        }
        if let Some(last) = self.last.filter(|last| *last >= wanted) {
            return Err(FrameOrderError::NotRising { last, wanted });
        }
        self.last = Some(wanted);
        self.open = Some(Digest::new(wanted));
        Ok(())
    }

    /// Whether `items` may be all items of `frame`.
    ///
    /// # Errors
    /// If they exceed the limit, or are a part of an item on the wire.
    pub fn check(&self, frame: FrameNumber, items: &[I]) -> Result<(), FrameOrderError> {
        self.check_after(0, frame, items)
    }

    fn check_after(&self, before: u64, frame: FrameNumber, items: &[I]) -> Result<(), FrameOrderError> {
        let (bytes, item, most) = (items.len() * I::SIZE, self.item, self.most);
        if !bytes.is_multiple_of(item) {
            return Err(FrameOrderError::Part { bytes, item });
        }
        if before + (bytes / item) as u64 > u64::from(most) {
            return Err(FrameOrderError::TooMany { frame, most });
        }
        Ok(())
    }

    /// Adds items to the open frame, and emits every batch that is full.
    ///
    /// # Errors
    /// If no frame is open, it would exceed its limit of items, or they are a part of an item on the wire;
    /// then none of them is added.
    pub fn push(
        &mut self,
        mut items: &[I],
        mut emit: impl FnMut(FrameMessage),
    ) -> Result<(), FrameOrderError> {
        let Digest { frame, items: emitted, .. } = self.open.as_ref().ok_or(FrameOrderError::NoneOpen)?;
        self.check_after(emitted + (self.pending.len() / self.item) as u64, *frame, items)?;
        let full = self.batch.items() * self.item;
        while !items.is_empty() {
            let free = full.saturating_sub(self.pending.len()) / I::SIZE;
            let (now, later) = items.split_at(free.min(items.len()));
            // The rest of an allocation may be smaller than a batch: enough for the last items of a frame.
            if self.pending.is_empty() && self.pending.capacity() < now.len() * I::SIZE {
                self.pending.reserve(full.max(ROOM.min(items.len() * I::SIZE)));
            }
            put_items(&mut self.pending, now);
            items = later;
            if self.pending.len() == full {
                self.flush(&mut emit)?;
            }
        }
        Ok(())
    }

    /// Emits pending items without waiting for a full batch.
    ///
    /// # Errors
    /// If no frame is open.
    pub fn flush(&mut self, mut emit: impl FnMut(FrameMessage)) -> Result<(), FrameOrderError> {
        let digest = self.open.as_mut().ok_or(FrameOrderError::NoneOpen)?;
        if !self.pending.is_empty() {
            let batch = self.pending.split().freeze();
            digest.add(batch.len() / self.item, &batch);
            emit(FrameMessage::Batch(batch));
        }
        Ok(())
    }

    /// Ends the open frame: emits pending items, then the end.
    ///
    /// # Errors
    /// If no frame is open.
    pub fn finish(&mut self, mut emit: impl FnMut(FrameMessage)) -> Result<FrameEnd, FrameOrderError> {
        self.flush(&mut emit)?;
        let digest = self.open.take().ok_or(FrameOrderError::NoneOpen)?;
        let frame = digest.frame;
        // The limit has kept the number below that.
        let items = u32::try_from(digest.items).unwrap_or(self.most);
        let end = FrameEnd { frame, items, hash: digest.hasher.digest() };
        emit(FrameMessage::End(end));
        Ok(end)
    }
}

/// A caller that breaks the order of begin, push and finish.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum FrameOrderError {
    /// `begin` before `finish`.
    #[error("{wanted} cannot begin before {open} is finished")]
    StillOpen {
        /// The frame that is open.
        open: FrameNumber,
        /// The frame that should begin.
        wanted: FrameNumber,
    },
    /// Frame numbers must rise on a link.
    #[error("{wanted} cannot follow {last}: frame numbers rise")]
    NotRising {
        /// The frame before.
        last: FrameNumber,
        /// The frame that should begin.
        wanted: FrameNumber,
    },
    /// `push` or `finish` before `begin`.
    #[error("no frame is open: begin one first")]
    NoneOpen,
    /// Not a whole number of items, where their size is known only at run time.
    #[error("{bytes} bytes are not a whole number of items of {item} bytes")]
    Part {
        /// The number of bytes.
        bytes: usize,
        /// The bytes of an item.
        item: usize,
    },
    /// More items than a frame may have.
    #[error("{frame} has more than {most} items, the most that a frame may have here")]
    TooMany {
        /// The frame.
        frame: FrameNumber,
        /// The limit.
        most: u32,
    },
}
