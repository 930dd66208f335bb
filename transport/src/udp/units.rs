//! A lane of units over datagrams, for frames and records.

use std::sync::Arc;
use std::task::{Context, Poll};

use trimaran_udp::{Received, UnitLane};
use trimaran_wire::Kind;

use super::port::{Carrier, State, Waiter};
use crate::error::{LaneError, Loss};
use crate::stats::Counters;

/// The sending half.
#[derive(Debug)]
pub(super) struct UnitTx {
    pub(super) carrier: Arc<Carrier>,
    lane: UnitLane,
    /// The lane has ended with a close.
    ended: bool,
}

impl UnitTx {
    pub(super) fn new(carrier: &Arc<Carrier>, lane: UnitLane) -> Self {
        Self { carrier: Arc::clone(carrier), lane, ended: false }
    }

    /// Calls `put` once there is room, and sends the result.
    pub(super) fn poll_room(&self, cx: &Context<'_>, put: impl FnOnce(&mut State)) -> Poll<Result<(), Loss>> {
        let mut state = self.carrier.lock();
        let stopped = state.connection.is_stopped(self.lane).then_some(Loss::Closed);
        if let Some(loss) = state.loss().or(stopped) {
            return Poll::Ready(Err(loss));
        }
        if !state.connection.is_writable(self.lane) {
            state.wait(Waiter::UnitTx(self.lane), cx);
            return Poll::Pending;
        }
        put(&mut state);
        self.carrier.port().flush(&mut state);
        Poll::Ready(Ok(()))
    }

    /// Passes something on, whether there is room or not.
    pub(super) fn put(&self, put: impl FnOnce(&mut State)) {
        let mut state = self.carrier.lock();
        put(&mut state);
        self.carrier.port().flush(&mut state);
    }

    /// Ends the lane behind its close, once everything has arrived.
    pub(super) fn poll_closed(&mut self, cx: &Context<'_>) -> Poll<Result<(), Loss>> {
        self.ended = true;
        let mut state = self.carrier.lock();
        if state.connection.is_lane_drained(self.lane) || state.peer_has_left() {
            return Poll::Ready(Ok(()));
        }
        if let Some(loss) = state.loss() {
            return Poll::Ready(Err(loss));
        }
        state.wait(Waiter::UnitTx(self.lane), cx);
        Poll::Pending
    }
}

impl Drop for UnitTx {
    fn drop(&mut self) {
        if !self.ended {
            let mut state = self.carrier.lock();
            state.connection.gone(self.lane);
            self.carrier.port().flush(&mut state);
        }
    }
}

/// The receiving half.
#[derive(Debug)]
pub(super) struct UnitRx {
    carrier: Arc<Carrier>,
    lane: UnitLane,
    counters: Arc<Counters>,
    closed: Option<Received>,
}

impl UnitRx {
    pub(super) fn new(carrier: &Arc<Carrier>, lane: UnitLane, counters: &Arc<Counters>) -> Self {
        Self { carrier: Arc::clone(carrier), lane, counters: Arc::clone(counters), closed: None }
    }

    pub(super) fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The next item, unless the lane has ended.
    pub(super) fn poll_next(&mut self, cx: &Context<'_>) -> Poll<Result<Received, LaneError>> {
        if let Some(end) = &self.closed {
            return Poll::Ready(ended(end.clone()));
        }
        let mut state = self.carrier.lock();
        let received = state.connection.recv(self.lane);
        // Reading may give the peer room.
        self.carrier.port().flush(&mut state);
        if let Some(received) = received {
            if matches!(received, Received::Closed(_) | Received::Gone) {
                self.counters.received.count(Kind::Close, 0);
                self.closed = Some(received.clone());
            }
            return Poll::Ready(ended(received));
        }
        if let Some(end) = state.end() {
            return Poll::Ready(Err(end));
        }
        state.wait(Waiter::UnitRx(self.lane), cx);
        Poll::Pending
    }
}

/// The item, unless it is the end of its lane.
fn ended(received: Received) -> Result<Received, LaneError> {
    match received {
        Received::Closed(reason) => Err(LaneError::Closed(reason)),
        Received::Gone => Err(LaneError::Lost(Loss::Closed)),
        data => Ok(data),
    }
}

impl Drop for UnitRx {
    /// Tells the peer that the lane is no longer read.
    fn drop(&mut self) {
        let mut state = self.carrier.lock();
        state.connection.stop_reading(self.lane);
        self.carrier.port().flush(&mut state);
    }
}
