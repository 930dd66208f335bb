//! The frames lane over a byte stream of its own.

use parking_lot::Mutex;
use std::future::poll_fn;
use std::mem;
use std::sync::Arc;
use std::task::{Context, Waker};

use trimaran_wire::{FrameMessage, Lane, Message};

use super::inlet::{Inlet, Reader};
use super::pulse::Pulse;
use super::source::{Sink, Source};
use crate::error::{LaneError, LaneSendError, Loss, misplaced};
use crate::lanes::shared::Shared;
use crate::stats::Counters;
use crate::timeouts::{Expired, Timeouts};
use trimaran_net::Instant;

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

    pub(crate) fn stage(&mut self, message: impl Into<Message>, shared: &Shared) {
        self.outlet.state.lock().sink.stage(&message.into(), &shared.counters.sent);
    }

    /// Writes staged messages. Any progress restarts the timeout, and a hanging peer is noticed earlier.
    pub(crate) async fn send_staged(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        let turn = Turn::take(&self.outlet);
        while !turn.state.lock().sink.is_drained() {
            timeouts
                .wait_while_alive(|| self.inlet.heard(), poll_fn(|cx| turn.state.lock().sink.poll_write(cx)))
                .await
                .map_err(|end| match end {
                    Expired::Idle => LaneSendError::Lost(Loss::Silent),
                    Expired::Timeout | Expired::Deadline => LaneSendError::Stalled,
                })?
                .map_err(|e| LaneSendError::Lost(Loss::Io(e)))?;
        }
        Ok(())
    }

    /// Tells the peer that nothing more comes.
    pub(crate) async fn close(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        self.outlet.state.lock().closed = true;
        timeouts
            .wait(None, poll_fn(|cx| self.outlet.state.lock().sink.poll_shutdown(cx)))
            .await
            .map_err(|_| LaneSendError::Stalled)?
            .map_err(|e| LaneSendError::Lost(Loss::Io(e)))
    }
}

/// The owner's turn to write. It ends with its future, finished or not.
struct Turn<'o>(&'o Outlet);

impl<'o> Turn<'o> {
    fn take(outlet: &'o Outlet) -> Self {
        let mut state = outlet.state.lock();
        state.waiting = true;
        state.spoke = true;
        drop(state);
        Self(outlet)
    }
}

impl std::ops::Deref for Turn<'_> {
    type Target = Outlet;

    fn deref(&self) -> &Outlet {
        self.0
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.state.lock().waiting = false;
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

#[derive(Debug)]
pub(crate) struct FrameRx(Reader);

/// Both halves of the lane.
pub(super) fn frames(sink: Sink, source: Source, counters: &Arc<Counters>) -> (FrameTx, FrameRx) {
    let inlet = Arc::new(Inlet::new(source.with_room(ROOM), ROOM));
    let tx = FrameTx::new(sink, counters, &inlet);
    (tx, FrameRx(Reader::new(inlet)))
}

impl FrameRx {
    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<FrameMessage, LaneError> {
        match self.0.next(by, shared, timeouts).await? {
            Message::Frame(message) => Ok(message),
            other => Err(misplaced(other.kind(), Lane::Frames)),
        }
    }
}
