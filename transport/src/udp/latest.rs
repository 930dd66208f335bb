//! The latest lane over datagrams.

use std::future::poll_fn;
use std::sync::Arc;
use std::task::Poll;

use trimaran_udp::LatestEnd;
use trimaran_wire::{CloseReason, FixedBytes, Kind};

use super::port::{Carrier, State, Waiter};
use crate::error::{LaneError, LaneSendError, Loss};
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

#[derive(Debug)]
pub(crate) struct LatestTx {
    carrier: Arc<Carrier>,
}

impl LatestTx {
    pub(crate) fn new(carrier: &Arc<Carrier>) -> Self {
        Self { carrier: Arc::clone(carrier) }
    }

    pub(crate) fn publish(&mut self, value: FixedBytes, shared: &Shared) -> Result<(), LaneSendError> {
        let mut state = self.carrier.lock();
        if let Some(loss) = state.loss() {
            return Err(LaneSendError::Lost(loss));
        }
        shared.counters.sent.count(Kind::Latest, shared.format.latest);
        state.connection.publish(value);
        self.carrier.port().flush(&mut state);
        Ok(())
    }

    pub(crate) async fn close(
        &mut self,
        reason: CloseReason,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.end(Some(reason));
        let arrived = poll_fn(|cx| {
            let mut state = self.carrier.lock();
            if state.connection.is_latest_drained() || state.peer_has_left() {
                return Poll::Ready(Ok(()));
            }
            if let Some(loss) = state.loss() {
                return Poll::Ready(Err(LaneSendError::Lost(loss)));
            }
            state.wait(Waiter::LatestTx, cx);
            Poll::Pending
        });
        timeouts.wait(None, arrived).await.map_err(|_| LaneSendError::Stalled)?
    }

    fn end(&self, reason: Option<CloseReason>) {
        let mut state = self.carrier.lock();
        state.connection.end_latest(reason);
        self.carrier.port().flush(&mut state);
    }
}

impl Drop for LatestTx {
    fn drop(&mut self) {
        self.end(None);
    }
}

#[derive(Debug)]
pub(crate) struct LatestRx {
    carrier: Arc<Carrier>,
}

impl LatestRx {
    pub(crate) fn new(carrier: &Arc<Carrier>) -> Self {
        Self { carrier: Arc::clone(carrier) }
    }

    pub(crate) fn try_latest(&mut self, shared: &Shared) -> Result<Option<FixedBytes>, LaneError> {
        next(&mut self.carrier.lock(), shared).transpose()
    }

    pub(crate) async fn latest(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<FixedBytes, LaneError> {
        let value = poll_fn(|cx| {
            let mut state = self.carrier.lock();
            match next(&mut state, shared) {
                Some(next) => Poll::Ready(next),
                None => {
                    state.wait(Waiter::LatestRx, cx);
                    Poll::Pending
                }
            }
        });
        timeouts.wait(by, value).await.map_err(LaneError::Expired)?
    }
}

/// The unread value, or the end of the lane; `None` if a value may still come.
fn next(state: &mut State, shared: &Shared) -> Option<Result<FixedBytes, LaneError>> {
    if let Some(value) = state.connection.latest() {
        shared.counters.received.count(Kind::Latest, shared.format.latest);
        return Some(Ok(value));
    }
    let ended = state.connection.latest_end().map(|end| match end {
        LatestEnd::Closed(reason) => LaneError::Closed(reason.clone()),
        _ => LaneError::Lost(Loss::Closed),
    });
    ended.or_else(|| state.end()).map(Err)
}
