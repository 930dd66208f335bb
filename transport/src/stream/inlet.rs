//! The receiving side of a lane: its owner reads it, and a sender that waits for room looks there for
//! keep-alives.

use parking_lot::Mutex;
use std::sync::Arc;
use std::task::{Context, Poll, Waker, ready};

use trimaran_wire::{CloseReason, Message};

use super::source::Source;
use crate::error::LaneError;
use crate::lanes::half::{Half, Rx};
use crate::stats::Counters;

/// A stream and the data read from it.
#[derive(Debug)]
pub(super) struct Inlet {
    state: Mutex<State>,
    counters: Arc<Counters>,
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
    /// Reads `room` bytes or more at once.
    pub(super) fn new(source: Source, room: usize, counters: &Arc<Counters>) -> Arc<Self> {
        let state = State { source: source.with_room(room), attended: false, heard: false, ended: None };
        Arc::new(Self { state: Mutex::new(state), counters: Arc::clone(counters), room })
    }

    /// The owner's next message; `None` if only a part of it has come.
    fn poll_next(&self, cx: &mut Context<'_>) -> Poll<Result<Option<Message>, LaneError>> {
        let mut state = self.state.lock();
        state.attended = false;
        let counts = &self.counters.received;
        if let Some(message) = state.source.next_buffered(counts)? {
            return Poll::Ready(Ok(Some(message)));
        }
        if let Some(end) = state.ended.take() {
            return Poll::Ready(Err(end));
        }
        let filled = state.source.poll_fill(cx);
        state.attended = filled.is_pending();
        ready!(filled)?;
        state.heard = true;
        Poll::Ready(state.source.next_buffered(counts))
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

/// Reads the messages of a lane of `T`, up to its close.
#[derive(Debug)]
pub(super) struct Reader<T> {
    inlet: Arc<Inlet>,
    closed: Option<CloseReason>,
    /// The data in a message.
    read: fn(Message) -> Result<T, LaneError>,
}

impl<T> Reader<T> {
    pub(super) const fn new(inlet: Arc<Inlet>, read: fn(Message) -> Result<T, LaneError>) -> Self {
        Self { inlet, closed: None, read }
    }
}

impl<T> Half for Reader<T>
where
    Self: std::fmt::Debug,
{
    fn rest(&mut self) {
        self.inlet.state.lock().attended = false;
    }
}

impl<T> Rx<T> for Reader<T>
where
    Self: std::fmt::Debug,
{
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<T>, LaneError>> {
        if let Some(reason) = &self.closed {
            return Poll::Ready(Err(LaneError::Closed(reason.clone())));
        }
        Poll::Ready(match ready!(self.inlet.poll_next(cx))? {
            Some(Message::Close(reason)) => {
                self.closed = Some(reason.clone());
                Err(LaneError::Closed(reason))
            }
            Some(Message::KeepAlive) | None => Ok(None),
            Some(message) => (self.read)(message).map(Some),
        })
    }
}
