//! Frames that are put together and coded once, and sent by many senders, each in its own time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use trimaran_wire::{Format, FrameEnd, FrameNumber, FrameOrderError, FrameStart, Protocol};

use super::published::{Assembly, PublishedFrame};
use crate::config::link::LinkConfig;

/// Puts frames together and codes them, once for many links of any transports. Each link sends them with
/// [`FrameSender::send_shared`](crate::FrameSender::send_shared), between frames of its own.
///
/// A [`Publisher`](crate::Publisher) also sends, by tasks of its own. Here the tasks that hold the links send:
/// they may leave out frames, and send other things in between.
#[derive(Debug)]
pub struct SharedFrames<P: Protocol> {
    assembly: Assembly<P>,
    /// Whether some link could not send the coded form of a frame.
    lacked: Arc<AtomicBool>,
}

/// A frame for many links. Clones are the same frame.
#[derive(Debug)]
pub struct SharedFrame<P: Protocol> {
    frame: Arc<PublishedFrame<P>>,
    lacked: Arc<AtomicBool>,
}

impl<P: Protocol> Clone for SharedFrame<P> {
    fn clone(&self) -> Self {
        Self { frame: Arc::clone(&self.frame), lacked: Arc::clone(&self.lacked) }
    }
}

impl<P: Protocol> SharedFrames<P> {
    /// Uses the batching and the frame limit of `config`. Links that take no coded batches get the frames
    /// plain.
    #[must_use]
    pub fn new(config: &LinkConfig) -> Self {
        let assembly = Assembly::new(config.batching, config.max_frame, Format::of::<P>().item);
        Self { assembly, lacked: Arc::default() }
    }

    /// Puts a frame together.
    ///
    /// # Errors
    /// If its number is not above the last one's, or it has too many items.
    pub fn put(
        &mut self,
        start: FrameStart<P::Header>,
        items: &[P::Item],
    ) -> Result<SharedFrame<P>, FrameOrderError> {
        let lacking = self.lacked.swap(false, Ordering::Relaxed);
        let frame = Arc::new(self.assembly.put(start, items, lacking)?);
        Ok(SharedFrame { frame, lacked: Arc::clone(&self.lacked) })
    }
}

impl<P: Protocol> SharedFrame<P> {
    /// Its totals.
    #[must_use]
    pub fn end(&self) -> FrameEnd {
        self.frame.end
    }

    pub(super) fn frame(&self) -> &PublishedFrame<P> {
        &self.frame
    }

    /// Whether it is coded, but not for a link that has the frames from `since` on.
    pub(super) fn is_coded_for_others_than(&self, since: FrameNumber) -> bool {
        self.frame.coded_since().is_some_and(|coded| since > coded)
    }

    /// Asks that coding begins anew, so that the link can have coded frames again.
    pub(super) fn ask_for_new_coding(&self) {
        self.lacked.store(true, Ordering::Relaxed);
    }
}

/// The shared frames that a link has sent without a gap.
#[derive(Debug)]
pub(super) struct LastShared {
    /// The sequence to which they belong.
    sequence: Arc<AtomicBool>,
    /// The first and the last, by their own numbers, and the link's number of the last.
    first: FrameNumber,
    last: FrameNumber,
    sent_as: FrameNumber,
}

impl LastShared {
    /// The state once `frame` is sent as `number`.
    pub(super) fn after<P: Protocol>(
        before: Option<Self>,
        frame: &SharedFrame<P>,
        number: FrameNumber,
    ) -> Self {
        let last = frame.frame.number();
        // Coded batches name earlier frames by the difference of numbers, so that must be the same.
        let step = |from: FrameNumber, to: FrameNumber| to.0.checked_sub(from.0);
        let goes_on = |before: &Self| {
            Arc::ptr_eq(&before.sequence, &frame.lacked)
                && frame.frame.before == Some(before.last)
                && step(before.last, last) == step(before.sent_as, number)
        };
        let first = before.filter(goes_on).map_or(last, |before| before.first);
        Self { sequence: Arc::clone(&frame.lacked), first, last, sent_as: number }
    }

    /// The first frame of those that the receiver has without a gap.
    pub(super) const fn first(&self) -> FrameNumber {
        self.first
    }
}
