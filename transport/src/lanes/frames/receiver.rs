//! Receives frames.

use std::collections::VecDeque;

use trimaran_net::Instant;
use trimaran_wire::{Format, FrameEvent, FrameMessage, FrameNumber, Protocol};

use super::events::Events;
use super::last::{KeepLast, LastFrames};
use super::whole::{Gathered, Gathering, WholeFrame};
use crate::error::RecvError;
use crate::lanes::ends::{Receiver, at_once};
use crate::rates::Messages;
use crate::stats::Skipped;

/// Receives frames: all of them, or with [`FrameReceiver::keep_last`] the newest.
///
/// A frame comes as events, by [`FrameReceiver::recv`], or as a whole, by [`FrameReceiver::frame`].
#[derive(Debug)]
pub struct FrameReceiver<P: Protocol> {
    source: Source<P>,
    /// The frame that has begun and not ended, in the events returned so far.
    open: Option<FrameNumber>,
    /// The frame that [`FrameReceiver::frame`] puts together, and the incomplete ones before it.
    gathering: Gathering<P>,
    skipped: Skipped,
}

#[derive(Debug)]
enum Source<P: Protocol> {
    Every(Box<Events<P>>),
    /// The events of a kept frame wait here.
    Last(Box<LastFrames<P>>, VecDeque<FrameEvent<P>>),
}

impl<P: Protocol> FrameReceiver<P> {
    pub(crate) fn new(
        max_frame: u32,
        format: &Format,
        lane: Receiver<FrameEvent<P>, FrameMessage>,
        rate: Messages,
    ) -> Self {
        let source = Source::Every(Box::new(Events::new(max_frame, *format, lane, rate)));
        Self { source, open: None, gathering: Gathering::default(), skipped: Skipped::default() }
    }

    /// From now on returns only the newest complete frames. A task reads the link, so that a reader of any
    /// speed neither holds up the peer nor sees old frames. A frame that has begun is left out.
    ///
    /// Skipped frames are counted in [`WholeFrame::skipped`] and [`LinkStats`](crate::LinkStats). Called
    /// again it changes the rule.
    ///
    /// ```
    /// # use trimaran_transport::{KeepLast, Link, Protocol, RecvError};
    /// # async fn show<P: Protocol>(mut link: Link<P>) -> Result<(), RecvError> {
    /// link.frames_rx = link.frames_rx.keep_last(KeepLast::default());
    /// loop {
    ///     let frame = link.frames_rx.frame().await?;
    ///     println!("{}, {:?} old, after {:?}", frame.start.frame, frame.age, frame.skipped);
    /// }
    /// # }
    /// ```
    #[must_use]
    pub fn keep_last(self, rule: KeepLast) -> Self {
        let source = match self.source {
            Source::Every(events) => Source::Last(Box::new(LastFrames::of(*events, rule)), VecDeque::new()),
            Source::Last(mut last, events) => {
                last.change(rule);
                Source::Last(last, events)
            }
        };
        Self { source, open: None, gathering: Gathering::default(), skipped: Skipped::default() }
    }

    /// Waits for the next event, for as long as the peer lives: a peer without frames is not lost. Dropping
    /// the future loses nothing.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol.
    pub async fn recv(&mut self) -> Result<FrameEvent<P>, RecvError> {
        self.event(None).await
    }

    /// As [`FrameReceiver::recv`], until `deadline` at most. Dropping the future loses nothing.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn recv_by(&mut self, deadline: Instant) -> Result<FrameEvent<P>, RecvError> {
        self.event(Some(deadline)).await
    }

    /// The next event if it has arrived, without waiting: for callers that poll to avoid the cost of being
    /// woken. A peer that hangs is not noticed this way.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol.
    pub fn try_recv(&mut self) -> Result<Option<FrameEvent<P>>, RecvError> {
        at_once(self.event(None))
    }

    /// Waits for the next complete frame, for as long as the peer lives. Frames that lack items are skipped.
    /// So is a frame that [`FrameReceiver::recv`] has begun. Dropping the future loses nothing.
    ///
    /// # Errors
    /// If the peer closed the link, is lost, or broke the protocol. Complete frames that came before are
    /// returned first.
    pub async fn frame(&mut self) -> Result<WholeFrame<P>, RecvError> {
        self.frame_until(None).await
    }

    /// As [`FrameReceiver::frame`], until `deadline` at most. Dropping the future loses nothing.
    ///
    /// # Errors
    /// As there, and [`RecvError::Deadline`].
    pub async fn frame_by(&mut self, deadline: Instant) -> Result<WholeFrame<P>, RecvError> {
        self.frame_until(Some(deadline)).await
    }

    /// The frame that has begun and not ended, in the events returned so far.
    #[must_use]
    pub const fn open_frame(&self) -> Option<FrameNumber> {
        self.open
    }

    async fn event(&mut self, by: Option<Instant>) -> Result<FrameEvent<P>, RecvError> {
        let event = match &mut self.source {
            Source::Every(events) => events.recv(by).await?,
            Source::Last(last, events) => match events.pop_front() {
                Some(event) => event,
                None => {
                    let (frame, _) = last.next(by).await?;
                    let begin;
                    (begin, *events) = frame.into_events();
                    begin
                }
            },
        };
        match &event {
            FrameEvent::Begin(start) => self.open = Some(start.frame),
            FrameEvent::Batch(_) => {}
            FrameEvent::End(_) => self.open = None,
        }
        Ok(event)
    }

    async fn frame_until(&mut self, by: Option<Instant>) -> Result<WholeFrame<P>, RecvError> {
        self.open = None;
        loop {
            match &mut self.source {
                Source::Every(events) => {
                    let event = events.recv(by).await?;
                    let now = events.net().now();
                    match self.gathering.take(event, now) {
                        Gathered::Part => {}
                        Gathered::Whole(frame) => {
                            return Ok(frame.returned(now, std::mem::take(&mut self.skipped)));
                        }
                        Gathered::Incomplete => {
                            self.skipped = self.skipped + Skipped::INCOMPLETE;
                            events.shared().counters.skip(Skipped::INCOMPLETE);
                        }
                    }
                }
                Source::Last(last, events) => {
                    events.clear();
                    let (frame, skipped) = last.next(by).await?;
                    return Ok(frame.returned(last.now(), skipped));
                }
            }
        }
    }

    /// Discards everything until the lane ends, and returns how it ended.
    pub(crate) async fn drain(&mut self) -> RecvError {
        loop {
            if let Err(end) = self.recv().await {
                return end;
            }
        }
    }
}
