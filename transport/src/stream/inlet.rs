//! The receiving side of a lane: its owner reads it, and a sender that waits for room looks there for
//! keep-alives.

use parking_lot::Mutex;
use std::future::poll_fn;
use std::sync::Arc;
use std::task::{Context, Poll, Waker, ready};

use trimaran_wire::{CloseReason, Message};

use super::source::Source;
use crate::error::LaneError;
use crate::lanes::shared::Shared;
use crate::stats::Direction;
use crate::timeouts::{Timeouts, Wait};
use trimaran_net::Instant;

/// A stream and the data read from it.
#[derive(Debug)]
pub(super) struct Inlet {
    state: Mutex<State>,
    /// The most bytes that a sender buffers while the owner does not read.
    room: usize,
}

#[derive(Debug)]
struct State {
    source: Source,
    /// The owner waits for more. Nobody else may read then, because a stream wakes only its last poller.
    attended: bool,
    /// Something came since a sender last asked.
    heard: bool,
    /// How the stream ended, if a sender noticed.
    ended: Option<LaneError>,
}

impl Inlet {
    pub(super) const fn new(source: Source, room: usize) -> Self {
        let state = State { source, attended: false, heard: false, ended: None };
        Self { state: Mutex::new(state), room }
    }

    /// A message that has arrived in full.
    pub(super) fn next_buffered(&self, counts: &Direction) -> Result<Option<Message>, LaneError> {
        self.state.lock().source.next_buffered(counts)
    }

    /// The owner's wait for more.
    pub(super) fn attend(&self) -> Attention<'_> {
        self.state.lock().attended = true;
        Attention(self)
    }

    /// Whether anything came since the last call. If more has come than is buffered for an idle owner, the
    /// peer counts as alive.
    pub(super) fn heard(&self) -> bool {
        let mut state = self.state.lock();
        if !state.attended && state.ended.is_none() {
            if state.source.pending() >= self.room {
                return true;
            }
            match state.source.poll_fill(&mut Context::from_waker(Waker::noop())) {
                Poll::Ready(Ok(())) => state.heard = true,
                Poll::Ready(Err(end)) => state.ended = Some(end),
                Poll::Pending => {}
            }
        }
        std::mem::take(&mut state.heard)
    }
}

/// The owner waits until this is dropped.
pub(super) struct Attention<'i>(&'i Inlet);

impl Attention<'_> {
    /// Reads what there is, at least one byte.
    pub(super) fn poll_fill(&self, cx: &mut Context<'_>) -> Poll<Result<(), LaneError>> {
        let mut state = self.0.state.lock();
        if let Some(end) = state.ended.take() {
            return Poll::Ready(Err(end));
        }
        let filled = ready!(state.source.poll_fill(cx));
        state.heard = true;
        Poll::Ready(filled)
    }
}

impl Drop for Attention<'_> {
    fn drop(&mut self) {
        self.0.state.lock().attended = false;
    }
}

/// Reads the messages of a lane, up to its close.
#[derive(Debug)]
pub(super) struct Reader {
    inlet: Arc<Inlet>,
    closed: Option<CloseReason>,
}

impl Reader {
    pub(super) const fn new(inlet: Arc<Inlet>) -> Self {
        Self { inlet, closed: None }
    }

    /// The next message, without keep-alives.
    pub(super) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<Message, LaneError> {
        if let Some(reason) = &self.closed {
            return Err(LaneError::Closed(reason.clone()));
        }
        let mut wait = Wait::default();
        loop {
            let buffered = self.inlet.next_buffered(&shared.counters.received)?;
            if buffered.is_some() {
                timeouts.heard();
            }
            match buffered {
                Some(Message::Close(reason)) => {
                    self.closed = Some(reason.clone());
                    return Err(LaneError::Closed(reason));
                }
                Some(Message::KeepAlive) => {}
                Some(message) => return Ok(message),
                None => {
                    let attention = self.inlet.attend();
                    timeouts
                        .hear(&mut wait, by, poll_fn(|cx| attention.poll_fill(cx)))
                        .await
                        .map_err(LaneError::Expired)??;
                }
            }
        }
    }
}
