//! The latest lane over datagrams.

use std::sync::Arc;
use std::task::{Context, Poll};

use trimaran_udp::LatestEnd;
use trimaran_wire::{CloseReason, FixedBytes, Kind};

use super::port::{Carrier, State, Waiter};
use crate::error::{LaneError, Loss};
use crate::lanes::half::{Half, LaneTx, Rx, Tx};
use crate::stats::Counters;

#[derive(Debug)]
pub(crate) struct LatestTx {
    carrier: Arc<Carrier>,
    counters: Arc<Counters>,
}

impl LatestTx {
    pub(crate) fn new(carrier: &Arc<Carrier>, counters: &Arc<Counters>) -> Self {
        Self { carrier: Arc::clone(carrier), counters: Arc::clone(counters) }
    }

    fn end(&self, reason: Option<CloseReason>) {
        let mut state = self.carrier.lock();
        state.connection.end_latest(reason);
        self.carrier.port().flush(&mut state);
    }
}

impl Half for LatestTx {}

impl LaneTx for LatestTx {
    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.end(Some(reason));
        Ok(())
    }

    fn poll_closed(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        let mut state = self.carrier.lock();
        if state.connection.is_latest_drained() || state.peer_has_left() {
            return Poll::Ready(Ok(()));
        }
        if let Some(loss) = state.loss() {
            return Poll::Ready(Err(loss));
        }
        state.wait(Waiter::LatestTx, cx);
        Poll::Pending
    }
}

impl Tx<FixedBytes> for LatestTx {
    fn stage(&mut self, value: FixedBytes) -> Result<(), Loss> {
        let mut state = self.carrier.lock();
        if let Some(loss) = state.loss() {
            return Err(loss);
        }
        self.counters.sent.count(Kind::Latest, value.len());
        state.connection.publish(value);
        self.carrier.port().flush(&mut state);
        Ok(())
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
    counters: Arc<Counters>,
}

impl LatestRx {
    pub(crate) fn new(carrier: &Arc<Carrier>, counters: &Arc<Counters>) -> Self {
        Self { carrier: Arc::clone(carrier), counters: Arc::clone(counters) }
    }
}

impl Half for LatestRx {}

impl Rx<FixedBytes> for LatestRx {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<FixedBytes>, LaneError>> {
        let mut state = self.carrier.lock();
        if let Some(value) = state.connection.latest() {
            self.counters.received.count(Kind::Latest, value.len());
            return Poll::Ready(Ok(Some(value)));
        }
        if let Some(end) = end(&state) {
            return Poll::Ready(Err(end));
        }
        state.wait(Waiter::LatestRx, cx);
        Poll::Pending
    }
}

/// The end of the lane; `None` if a value may still come.
fn end(state: &State) -> Option<LaneError> {
    let ended = state.connection.latest_end().map(|end| match end {
        LatestEnd::Closed(reason) => LaneError::Closed(reason.clone()),
        _ => LaneError::Lost(Loss::Closed),
    });
    ended.or_else(|| state.end())
}
