//! A frame of ids: written, checked, judged.

use std::fmt;

use bytes::BytesMut;
use thiserror::Error;
use xxhash_rust::xxh3::Xxh3;

use crate::batch::put_ids;
use crate::{BatchSize, Camera, DrawableId, FrameNumber, FrameStats, IdBatch};

/// How a frame begins: its number, and the camera that its ids were culled for.
///
/// The camera's own frame number is the one that the display gave it; in live mode that may be another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameStart {
    /// The frame that the ids are for.
    pub frame: FrameNumber,
    /// The camera that it was culled for.
    pub camera: Camera,
}

/// How a frame ends: what must have arrived by then.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameEnd {
    /// The frame that ends.
    pub frame: FrameNumber,
    /// How many ids it had.
    pub ids: u32,
    /// XXH3-64 (seed 0) of the ids in order, as they travel.
    pub hash: u64,
}

/// The messages of the frames lane.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameMessage {
    /// A frame begins.
    Begin(FrameStart),
    /// Ids of the frame that has begun.
    Ids(IdBatch),
    /// The frame ends.
    End(FrameEnd),
    /// What the sender did for a frame that has ended.
    Stats(FrameStats),
}

/// What a receiver of frames learns.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameEvent {
    /// A frame begins.
    Begin(FrameStart),
    /// Ids of the frame that has begun, in the order in which they were pushed.
    Ids(IdBatch),
    /// The frame is over.
    End(FrameOutcome),
    /// What the sender did for a frame that is over; between frames.
    Stats(FrameStats),
}

/// What became of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameOutcome {
    /// Every id arrived, in order.
    Complete(FrameEnd),
    /// Some ids are missing: what they named counts as visible until the next frame.
    Incomplete {
        /// The frame.
        frame: FrameNumber,
        /// How many ids were sent.
        expected: u32,
        /// How many arrived.
        received: u32,
    },
}

/// A peer that breaks the order of the frames lane, or whose ids are not those that it announced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum FrameViolation {
    /// A frame began while another was open.
    #[error("{begun} began before the end of {open}")]
    BeginInsideFrame {
        /// The frame that is open.
        open: FrameNumber,
        /// The frame that began.
        begun: FrameNumber,
    },
    /// Frame numbers must rise.
    #[error("{begun} began after {last}")]
    NotRising {
        /// The frame before.
        last: FrameNumber,
        /// The frame that began.
        begun: FrameNumber,
    },
    /// Ids came outside of a frame.
    #[error("{count} ids came outside of a frame")]
    IdsOutsideFrame {
        /// How many.
        count: usize,
    },
    /// An end came outside of a frame.
    #[error("the end of {ended} came outside of a frame")]
    EndOutsideFrame {
        /// The frame that ended.
        ended: FrameNumber,
    },
    /// Another frame ended than the one that is open.
    #[error("the end of {ended} came within {open}")]
    EndOfOtherFrame {
        /// The frame that is open.
        open: FrameNumber,
        /// The frame that ended.
        ended: FrameNumber,
    },
    /// Statistics came inside of a frame.
    #[error("statistics came before {open} ended")]
    StatsInsideFrame {
        /// The frame that is open.
        open: FrameNumber,
    },
    /// More ids came than the end announces.
    #[error("{frame} had {received} ids, its end announces {announced}")]
    TooMany {
        /// The frame.
        frame: FrameNumber,
        /// What the end says.
        announced: u32,
        /// What came.
        received: u64,
    },
    /// As many ids came as announced, but not the same ones.
    #[error("the ids of {frame} hash to {received:016x}, its end announces {announced:016x}")]
    Hash {
        /// The frame.
        frame: FrameNumber,
        /// What the end says.
        announced: u64,
        /// What came.
        received: u64,
    },
}

/// Counts and hashes the ids of one frame.
struct Digest {
    frame: FrameNumber,
    ids: u64,
    hasher: Xxh3,
}

impl Digest {
    fn new(frame: FrameNumber) -> Self {
        Self { frame, ids: 0, hasher: Xxh3::new() }
    }

    fn add(&mut self, batch: &IdBatch) {
        self.ids += batch.count() as u64;
        self.hasher.update(batch.as_bytes());
    }
}

/// Checks what arrives on the frames lane: order, count and hash.
#[derive(Default)]
pub struct FrameAssembler {
    open: Option<Digest>,
    last: Option<FrameNumber>,
}

impl fmt::Debug for FrameAssembler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let open = self.open.as_ref().map(|digest| (digest.frame, digest.ids));
        f.debug_struct("FrameAssembler").field("open", &open).field("last", &self.last).finish()
    }
}

impl FrameAssembler {
    /// An assembler that waits for a first frame.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The frame that has begun and not ended.
    #[must_use]
    pub fn open_frame(&self) -> Option<FrameNumber> {
        self.open.as_ref().map(|digest| digest.frame)
    }

    /// Takes the next message.
    ///
    /// # Errors
    /// When it cannot come now or contradicts what came before. The peer cannot be trusted after that.
    pub fn take(&mut self, message: FrameMessage) -> Result<FrameEvent, FrameViolation> {
        match message {
            FrameMessage::Begin(start) => self.begin(start),
            FrameMessage::Ids(batch) => match &mut self.open {
                Some(digest) => {
                    digest.add(&batch);
                    Ok(FrameEvent::Ids(batch))
                }
                None => Err(FrameViolation::IdsOutsideFrame { count: batch.count() }),
            },
            FrameMessage::End(end) => self.end(end),
            FrameMessage::Stats(stats) => match &self.open {
                None => Ok(FrameEvent::Stats(stats)),
                Some(digest) => Err(FrameViolation::StatsInsideFrame { open: digest.frame }),
            },
        }
    }

    fn begin(&mut self, start: FrameStart) -> Result<FrameEvent, FrameViolation> {
        let begun = start.frame;
        if let Some(digest) = &self.open {
            return Err(FrameViolation::BeginInsideFrame { open: digest.frame, begun });
        }
        if let Some(last) = self.last.filter(|last| *last >= begun) {
            return Err(FrameViolation::NotRising { last, begun });
        }
        self.last = Some(begun);
        self.open = Some(Digest::new(begun));
        Ok(FrameEvent::Begin(start))
    }

    fn end(&mut self, end: FrameEnd) -> Result<FrameEvent, FrameViolation> {
        let Some(digest) = self.open.take() else {
            return Err(FrameViolation::EndOutsideFrame { ended: end.frame });
        };
        let frame = digest.frame;
        if frame != end.frame {
            return Err(FrameViolation::EndOfOtherFrame { open: frame, ended: end.frame });
        }
        let announced = end.ids;
        match u32::try_from(digest.ids) {
            Ok(received) if received < announced => {
                Ok(FrameEvent::End(FrameOutcome::Incomplete { frame, expected: announced, received }))
            }
            Ok(received) if received == announced => {
                let received = digest.hasher.digest();
                if received == end.hash {
                    Ok(FrameEvent::End(FrameOutcome::Complete(end)))
                } else {
                    Err(FrameViolation::Hash { frame, announced: end.hash, received })
                }
            }
            _ => Err(FrameViolation::TooMany { frame, announced, received: digest.ids }),
        }
    }
}

/// Turns begin, pushed ids and finish into messages: ids are gathered into batches of `b`.
///
/// It hands each message to the `emit` of the call that completed it.
pub struct FrameWriter {
    batch: BatchSize,
    pending: BytesMut,
    open: Option<Digest>,
    last: Option<FrameNumber>,
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
    /// A frame of more than `u32::MAX` ids.
    #[error("{frame} has more ids than 32 bits can count")]
    TooMany {
        /// The frame.
        frame: FrameNumber,
    },
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
        Self { batch, pending: BytesMut::new(), open: None, last: None }
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
    /// When no frame is open.
    pub fn push(
        &mut self,
        mut ids: &[DrawableId],
        mut emit: impl FnMut(FrameMessage),
    ) -> Result<(), FrameOrderError> {
        if self.open.is_none() {
            return Err(FrameOrderError::NoneOpen);
        }
        while !ids.is_empty() {
            let free = self.batch.bytes().saturating_sub(self.pending.len()) / crate::ID_BYTES;
            let (now, later) = ids.split_at(free.min(ids.len()));
            if self.pending.is_empty() {
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
    /// When no frame is open, or it had more than `u32::MAX` ids.
    pub fn finish(&mut self, mut emit: impl FnMut(FrameMessage)) -> Result<FrameEnd, FrameOrderError> {
        self.flush(&mut emit)?;
        let digest = self.open.take().ok_or(FrameOrderError::NoneOpen)?;
        let frame = digest.frame;
        let ids = u32::try_from(digest.ids).map_err(|_| FrameOrderError::TooMany { frame })?;
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
