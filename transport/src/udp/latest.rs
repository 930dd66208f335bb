//! The latest lane over datagrams, and channels of values.

use std::sync::Arc;
use std::task::{Context, Poll};

use trimaran_udp::LatestEnd;
use trimaran_wire::{ChannelNumber, CloseReason, FixedBytes, Kind};

use super::port::{Carrier, State, Waiter};
use crate::error::{LaneError, Loss};
use crate::lanes::half::{Half, LaneTx, Rx, Tx};
use crate::stats::Counters;

#[derive(Debug)]
pub(crate) struct LatestTx {
    carrier: Arc<Carrier>,
    /// The channel, unless it is the latest lane.
    channel: Option<ChannelNumber>,
    counters: Arc<Counters>,
}

impl LatestTx {
    pub(crate) fn new(
        carrier: &Arc<Carrier>,
        channel: Option<ChannelNumber>,
        counters: &Arc<Counters>,
    ) -> Self {
        Self { carrier: Arc::clone(carrier), channel, counters: Arc::clone(counters) }
    }

    fn end(&self, reason: Option<CloseReason>) {
        let mut state = self.carrier.lock();
        state.connection.end_latest(self.channel, reason);
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
        if state.connection.is_latest_drained(self.channel) || state.peer_has_left() {
            return Poll::Ready(Ok(()));
        }
        if let Some(loss) = state.loss() {
            return Poll::Ready(Err(loss));
        }
        state.wait(Waiter::LatestTx(self.channel), cx);
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
        state.connection.publish(self.channel, value);
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
    /// The channel, unless it is the latest lane.
    channel: Option<ChannelNumber>,
    counters: Arc<Counters>,
}

impl LatestRx {
    pub(crate) fn new(
        carrier: &Arc<Carrier>,
        channel: Option<ChannelNumber>,
        counters: &Arc<Counters>,
    ) -> Self {
        Self { carrier: Arc::clone(carrier), channel, counters: Arc::clone(counters) }
    }
}

impl Half for LatestRx {}

impl Rx<FixedBytes> for LatestRx {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<FixedBytes>, LaneError>> {
        let mut state = self.carrier.lock();
        if let Some(value) = state.connection.latest(self.channel) {
            self.counters.received.count(Kind::Latest, value.len());
            return Poll::Ready(Ok(Some(value)));
        }
        if let Some(end) = end(&state, self.channel) {
            return Poll::Ready(Err(end));
        }
        state.wait(Waiter::LatestRx(self.channel), cx);
        Poll::Pending
    }
}

/// The end of the lane; `None` if a value may still come.
fn end(state: &State, channel: Option<ChannelNumber>) -> Option<LaneError> {
    let ended = state.connection.latest_end(channel).map(|end| match end {
        LatestEnd::Closed(reason) => LaneError::Closed(reason.clone()),
        _ => LaneError::Lost(Loss::Closed),
    });
    ended.or_else(|| state.end())
}
