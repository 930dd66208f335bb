//! A frame of ids, turned into messages.

use std::fmt;

use bytes::BytesMut;
use thiserror::Error;

use super::{Digest, FrameEnd, FrameMessage, FrameStart};
use crate::batch::put_ids;
use crate::{BatchSize, DrawableId, FrameNumber, FrameStats, IdBatch};

/// Turns begin, pushed ids and finish into messages: ids are gathered into batches of `b`.
///
/// It hands each message to the `emit` of the call that completed it.
pub struct FrameWriter {
    batch: BatchSize,
    most: u32,
    pending: BytesMut,
    open: Option<Digest>,
    last: Option<FrameNumber>,
}

/// Ids for which room is made at once; small batches are carved from it, so that few of them allocate.
const ROOM: usize = 16 * 1024;

impl fmt::Debug for FrameWriter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let open = self.open.as_ref().map(|digest| digest.frame);
        f.debug_struct("FrameWriter").field("batch", &self.batch).field("open", &open).finish_non_exhaustive()
    }
}

impl FrameWriter {
    /// A writer of batches of at most `batch` ids.
    #[must_use]
    pub fn new(batch: BatchSize) -> Self {
        Self { batch, most: u32::MAX, pending: BytesMut::new(), open: None, last: None }
    }

    /// The same for frames of at most `most` ids.
    #[must_use]
    pub const fn of_at_most(mut self, most: u32) -> Self {
        self.most = most;
        self
    }

    /// Begins a frame.
    ///
    /// # Errors
    /// When one is open, or `start.frame` is not above the frame before.
    pub fn begin(&mut self, start: FrameStart) -> Result<FrameMessage, FrameOrderError> {
        let wanted = start.frame;
        if let Some(digest) = &self.open {
            return Err(FrameOrderError::StillOpen { open: digest.frame, wanted });
        }
        if let Some(last) = self.last.filter(|last| *last >= wanted) {
            return Err(FrameOrderError::NotRising { last, wanted });
        }
        self.last = Some(wanted);
        self.open = Some(Digest::new(wanted));
        Ok(FrameMessage::Begin(start))
    }

    /// Adds ids to the open frame, and emits every batch that is full.
    ///
    /// # Errors
    /// When no frame is open, or it would have more ids than it may; then none of them is added.
    pub fn push(
        &mut self,
        mut ids: &[DrawableId],
        mut emit: impl FnMut(FrameMessage),
    ) -> Result<(), FrameOrderError> {
        let Digest { frame, ids: emitted, .. } = self.open.as_ref().ok_or(FrameOrderError::NoneOpen)?;
        let count = emitted + (self.pending.len() / crate::ID_BYTES + ids.len()) as u64;
        if count > u64::from(self.most) {
            return Err(FrameOrderError::TooMany { frame: *frame, most: self.most });
        }
        while !ids.is_empty() {
            let free = self.batch.bytes().saturating_sub(self.pending.len()) / crate::ID_BYTES;
            let (now, later) = ids.split_at(free.min(ids.len()));
            // Less than a batch may be left of the room: enough for the last ids of a frame.
            if self.pending.is_empty() && self.pending.capacity() < now.len() * crate::ID_BYTES {
                self.pending.reserve(self.batch.bytes().max(ROOM.min(ids.len() * crate::ID_BYTES)));
            }
            put_ids(&mut self.pending, now);
            ids = later;
            if self.pending.len() == self.batch.bytes() {
                self.flush(&mut emit)?;
            }
        }
        Ok(())
    }

    /// Emits what is pending without waiting for a full batch.
    ///
    /// # Errors
    /// When no frame is open.
    pub fn flush(&mut self, mut emit: impl FnMut(FrameMessage)) -> Result<(), FrameOrderError> {
        let digest = self.open.as_mut().ok_or(FrameOrderError::NoneOpen)?;
        // Pending ids are whole and never more than a batch: only an empty batch is refused here.
        if let Ok(batch) = IdBatch::new(self.pending.split().freeze()) {
            digest.add(&batch);
            emit(FrameMessage::Ids(batch));
        }
        Ok(())
    }

    /// Ends the open frame: emits what is pending, then the end.
    ///
    /// # Errors
    /// When no frame is open.
    pub fn finish(&mut self, mut emit: impl FnMut(FrameMessage)) -> Result<FrameEnd, FrameOrderError> {
        self.flush(&mut emit)?;
        let digest = self.open.take().ok_or(FrameOrderError::NoneOpen)?;
        let frame = digest.frame;
        // No more were taken than that.
        let ids = u32::try_from(digest.ids).unwrap_or(self.most);
        let end = FrameEnd { frame, ids, hash: digest.hasher.digest() };
        emit(FrameMessage::End(end));
        Ok(end)
    }

    /// Says what the sender did for a frame that is over.
    ///
    /// # Errors
    /// When a frame is open.
    pub fn stats(&self, stats: FrameStats) -> Result<FrameMessage, FrameOrderError> {
        match &self.open {
            Some(digest) => Err(FrameOrderError::StatsInsideFrame { open: digest.frame }),
            None => Ok(FrameMessage::Stats(stats)),
        }
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
    /// Statistics before `finish`.
    #[error("statistics cannot be sent before {open} is finished")]
    StatsInsideFrame {
        /// The frame that is open.
        open: FrameNumber,
    },
    /// More ids than a frame may have.
    #[error("{frame} has more than {most} ids, the most that a frame may have here")]
    TooMany {
        /// The frame.
        frame: FrameNumber,
        /// The most that it may have.
        most: u32,
    },
}
