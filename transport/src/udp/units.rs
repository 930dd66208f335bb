//! A lane of units over datagrams, for frames and records.

use std::future::poll_fn;
use std::sync::Arc;
use std::task::Poll;

use trimaran_udp::{Received, UnitLane};
use trimaran_wire::Kind;

use super::port::{Carrier, State, Waiter};
use crate::error::{LaneError, LaneSendError, Loss};
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

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
    pub(super) async fn with_room(
        &self,
        timeouts: &mut Timeouts,
        mut put: impl FnMut(&mut State),
    ) -> Result<(), LaneSendError> {
        let put = poll_fn(|cx| {
            let mut state = self.carrier.lock();
            let stopped = state.connection.is_stopped(self.lane).then_some(Loss::Closed);
            if let Some(loss) = state.loss().or(stopped) {
                return Poll::Ready(Err(LaneSendError::Lost(loss)));
            }
            if !state.connection.is_writable(self.lane) {
                state.wait(Waiter::UnitTx(self.lane), cx);
                return Poll::Pending;
            }
            put(&mut state);
            self.carrier.port().flush(&mut state);
            Poll::Ready(Ok(()))
        });
        timeouts.wait(None, put).await.map_err(|_| LaneSendError::Stalled)?
    }

    /// Ends the lane behind its close, once everything has arrived.
    pub(super) async fn close(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        self.ended = true;
        let arrived = poll_fn(|cx| {
            let mut state = self.carrier.lock();
            if state.connection.is_lane_drained(self.lane) || state.peer_has_left() {
                return Poll::Ready(Ok(()));
            }
            if let Some(loss) = state.loss() {
                return Poll::Ready(Err(LaneSendError::Lost(loss)));
            }
            state.wait(Waiter::UnitTx(self.lane), cx);
            Poll::Pending
        });
        timeouts.wait(None, arrived).await.map_err(|_| LaneSendError::Stalled)?
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
    closed: Option<Received>,
}

impl UnitRx {
    pub(super) fn new(carrier: &Arc<Carrier>, lane: UnitLane) -> Self {
        Self { carrier: Arc::clone(carrier), lane, closed: None }
    }

    /// The next item, unless the lane has ended.
    pub(super) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<Received, LaneError> {
        let next = poll_fn(|cx| {
            if let Some(end) = self.closed.clone() {
                return Poll::Ready(Ok(end));
            }
            let mut state = self.carrier.lock();
            let received = state.connection.recv(self.lane);
            // Reading may give the peer room.
            self.carrier.port().flush(&mut state);
            if let Some(received) = received {
                return Poll::Ready(Ok(received));
            }
            if let Some(end) = state.end() {
                return Poll::Ready(Err(end));
            }
            state.wait(Waiter::UnitRx(self.lane), cx);
            Poll::Pending
        });
        let received = timeouts.wait(by, next).await.map_err(LaneError::Expired)??;
        let end = match &received {
            Received::Closed(reason) => LaneError::Closed(reason.clone()),
            Received::Gone => LaneError::Lost(Loss::Closed),
            _ => return Ok(received),
        };
        if self.closed.is_none() {
            shared.counters.received.count(Kind::Close, 0);
            self.closed = Some(received);
        }
        Err(end)
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
