//! The frames lane over a byte stream of its own.

use parking_lot::Mutex;
use std::mem;
use std::sync::Arc;
use std::task::{Context, Poll, Waker, ready};

use trimaran_wire::{CloseReason, FrameMessage, Lane, Message};

use super::inlet::{Inlet, Reader};
use super::pulse::Pulse;
use super::source::{Sink, Source};
use crate::error::{Loss, misplaced};
use crate::lanes::half::{Half, LaneTx, Tx};
use crate::stats::Counters;

/// How much is read at once: whole frames, mostly.
const ROOM: usize = 64 * 1024;

#[derive(Debug)]
pub(crate) struct FrameTx {
    outlet: Arc<Outlet>,
    /// The inlet for keep-alives while the peer takes nothing.
    inlet: Arc<Inlet>,
}

/// The writing side of the lane, with keep-alives while its owner is idle.
#[derive(Debug)]
pub(super) struct Outlet {
    state: Mutex<State>,
    counters: Arc<Counters>,
}

#[derive(Debug)]
struct State {
    sink: Sink,
    /// The owner waits for room. Nobody else may write then, because a stream wakes only its last poller.
    waiting: bool,
    /// Something was sent since the last beat.
    spoke: bool,
    closed: bool,
}

impl FrameTx {
    fn new(sink: Sink, counters: &Arc<Counters>, inlet: &Arc<Inlet>) -> Self {
        let state = Mutex::new(State { sink, waiting: false, spoke: false, closed: false });
        let outlet = Outlet { state, counters: Arc::clone(counters) };
        Self { outlet: Arc::new(outlet), inlet: Arc::clone(inlet) }
    }

    pub(super) fn outlet(&self) -> &Arc<Outlet> {
        &self.outlet
    }

    fn put(&self, message: &Message) {
        self.outlet.state.lock().sink.stage(message, &self.outlet.counters.sent);
    }
}

impl Half for FrameTx {
    fn rest(&mut self) {
        self.outlet.state.lock().waiting = false;
    }

    fn heard(&mut self) -> bool {
        self.inlet.heard()
    }
}

impl LaneTx for FrameTx {
    fn poll_send(&mut self, cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        let mut state = self.outlet.state.lock();
        (state.waiting, state.spoke) = (false, true);
        let mut wrote = false;
        while !state.sink.is_drained() {
            match state.sink.poll_write(cx) {
                Poll::Ready(Ok(())) => wrote = true,
                Poll::Ready(Err(e)) => return Poll::Ready(Err(Loss::Io(e))),
                Poll::Pending if wrote => return Poll::Ready(Ok(false)),
                Poll::Pending => {
                    state.waiting = true;
                    return Poll::Pending;
                }
            }
        }
        Poll::Ready(Ok(true))
    }

    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.put(&Message::Close(reason));
        Ok(())
    }

    /// Tells the peer that nothing more comes.
    fn poll_closed(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        let mut state = self.outlet.state.lock();
        state.closed = true;
        Poll::Ready(ready!(state.sink.poll_shutdown(cx)).map_err(Loss::Io))
    }
}

impl Tx<FrameMessage> for FrameTx {
    fn stage(&mut self, message: FrameMessage) -> Result<(), Loss> {
        self.put(&message.into());
        Ok(())
    }
}

impl Pulse for Outlet {
    fn beat(&self) -> bool {
        let mut state = self.state.lock();
        if state.closed {
            return false;
        }
        if state.waiting || mem::take(&mut state.spoke) {
            return true;
        }
        if state.sink.is_drained() {
            state.sink.stage(&Message::KeepAlive, &self.counters.sent);
        }
        // Bytes that the stream does not take now go with the next message; an error shows then.
        let _later = state.sink.poll_drain(&mut Context::from_waker(Waker::noop()));
        true
    }
}

/// Both halves of the lane.
pub(super) fn frames(
    sink: Sink,
    source: Source,
    counters: &Arc<Counters>,
) -> (FrameTx, Reader<FrameMessage>) {
    let inlet = Inlet::new(source, ROOM, counters);
    let tx = FrameTx::new(sink, counters, &inlet);
    let rx = Reader::new(inlet, |message| match message {
        Message::Frame(message) => Ok(message),
        other => Err(misplaced(other.kind(), Lane::Frames)),
    });
    (tx, rx)
}
