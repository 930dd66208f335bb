//! The frames lane over datagrams.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::sync::Arc;
use std::task::Poll;

use trimaran_udp::{DeadlineTooShort, Received};
use trimaran_wire::{CloseReason, FrameMessage, FrameNumber, Kind};

use super::port::{Carrier, State, Waiter};
use crate::error::{LaneError, LaneSendError, Loss};
use crate::link::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

#[derive(Debug)]
pub(crate) struct FrameTx {
    carrier: Arc<Carrier>,
    staged: VecDeque<Staged>,
    /// The lane has ended with a close.
    ended: bool,
    /// Somebody was told that frames have less time than the way takes.
    warned: bool,
}

/// What waits to be given to the connection.
#[derive(Debug)]
enum Staged {
    Frame(FrameMessage),
    Close(CloseReason),
}

impl FrameTx {
    pub(crate) fn new(carrier: &Arc<Carrier>) -> Self {
        Self { carrier: Arc::clone(carrier), staged: VecDeque::new(), ended: false, warned: false }
    }

    pub(crate) fn stage(&mut self, message: FrameMessage, shared: &Shared) {
        shared.counters.sent.count(message.kind(), message.payload());
        self.staged.push_back(Staged::Frame(message));
    }

    pub(crate) fn stage_close(&mut self, reason: CloseReason, shared: &Shared) {
        shared.counters.sent.count(Kind::Close, 0);
        self.staged.push_back(Staged::Close(reason));
    }

    /// The newest frame that the peer has all of.
    pub(crate) fn confirmed(&self) -> Option<FrameNumber> {
        self.carrier.lock().connection.confirmed_frame()
    }

    /// Gives what is staged to the connection. Whatever it takes starts the timeout anew.
    pub(crate) async fn send_staged(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        while !self.staged.is_empty() {
            let Self { carrier, staged, warned, .. } = self;
            let some = poll_fn(|cx| {
                let mut state = carrier.lock();
                if let Some(loss) = gone(&state) {
                    return Poll::Ready(Err(LaneSendError::Lost(loss)));
                }
                if !state.connection.is_writable() {
                    state.wait(Waiter::FrameTx, cx);
                    return Poll::Pending;
                }
                while state.connection.is_writable()
                    && let Some(message) = staged.pop_front()
                {
                    match message {
                        Staged::Frame(message) => state.connection.send(&message),
                        Staged::Close(reason) => state.connection.end_frames(reason),
                    }
                }
                carrier.port().flush(&mut state);
                if !*warned
                    && let Some(DeadlineTooShort { deadline, way }) = state.connection.deadline_too_short()
                {
                    *warned = true;
                    tracing::warn!(peer = %carrier.port().remote(), ?way, ?deadline, "the way to the peer takes longer than a frame may: hardly any will come whole; take a longer deadline, or a link without one");
                }
                Poll::Ready(Ok(()))
            });
            timeouts.wait(None, some).await.map_err(|_| LaneSendError::Stalled)??;
        }
        Ok(())
    }

    /// Ends the lane behind its close, once all of it has arrived.
    pub(crate) async fn close(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        self.ended = true;
        let arrived = poll_fn(|cx| {
            let mut state = self.carrier.lock();
            if state.connection.is_lane_drained() || state.peer_has_left() {
                return Poll::Ready(Ok(()));
            }
            if let Some(loss) = state.loss() {
                return Poll::Ready(Err(LaneSendError::Lost(loss)));
            }
            state.wait(Waiter::FrameTx, cx);
            Poll::Pending
        });
        timeouts.wait(None, arrived).await.map_err(|_| LaneSendError::Stalled)?
    }
}

/// Why nothing can be sent any more, if it cannot.
fn gone(state: &State) -> Option<Loss> {
    state.loss().or_else(|| state.connection.is_stopped().then_some(Loss::Closed))
}

impl Drop for FrameTx {
    fn drop(&mut self) {
        if !self.ended {
            let mut state = self.carrier.lock();
            state.connection.gone();
            self.carrier.port().flush(&mut state);
        }
    }
}

#[derive(Debug)]
pub(crate) struct FrameRx {
    carrier: Arc<Carrier>,
    closed: Option<Received>,
}

impl FrameRx {
    pub(crate) fn new(carrier: &Arc<Carrier>) -> Self {
        Self { carrier: Arc::clone(carrier), closed: None }
    }

    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<FrameMessage, LaneError> {
        let next = poll_fn(|cx| {
            if let Some(end) = self.closed.clone() {
                return Poll::Ready(Ok(end));
            }
            let mut state = self.carrier.lock();
            let received = state.connection.recv();
            // Reading may give the peer credit.
            self.carrier.port().flush(&mut state);
            if let Some(received) = received {
                return Poll::Ready(Ok(received));
            }
            if let Some(end) = state.end() {
                return Poll::Ready(Err(end));
            }
            state.wait(Waiter::FrameRx, cx);
            Poll::Pending
        });
        let received = timeouts.wait(by, next).await.map_err(LaneError::Expired)??;
        match received {
            Received::Frame(message) => {
                shared.counters.received.count(message.kind(), message.payload());
                Ok(message)
            }
            end => {
                if self.closed.is_none() {
                    shared.counters.received.count(Kind::Close, 0);
                    self.closed = Some(end.clone());
                }
                Err(match end {
                    Received::Closed(reason) => LaneError::Closed(reason),
                    _ => LaneError::Lost(Loss::Closed),
                })
            }
        }
    }
}

impl Drop for FrameRx {
    /// Tells the peer that nobody reads its frames any more.
    fn drop(&mut self) {
        let mut state = self.carrier.lock();
        state.connection.stop_reading();
        self.carrier.port().flush(&mut state);
    }
}
