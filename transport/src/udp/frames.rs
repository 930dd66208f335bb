//! The frames lane over datagrams.

use std::collections::VecDeque;
use std::sync::Arc;

use trimaran_udp::{DeadlineTooShort, Received, UnitLane};
use trimaran_wire::{CloseReason, FrameMessage, FrameNumber, Kind};

use super::port::{Carrier, State};
use super::records::wrong_unit;
use super::units::{UnitRx, UnitTx};
use crate::error::{LaneError, LaneSendError};
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

const LANE: UnitLane = UnitLane::Frames;

#[derive(Debug)]
pub(crate) struct FrameTx {
    lane: UnitTx,
    staged: VecDeque<Staged>,
    /// The warning that frames have less time than the path takes was given.
    warned: bool,
}

/// Waits to be passed to the connection.
#[derive(Debug)]
pub(crate) enum Staged {
    Frame(FrameMessage),
    Close(CloseReason),
}

impl From<FrameMessage> for Staged {
    fn from(message: FrameMessage) -> Self {
        Self::Frame(message)
    }
}

impl From<CloseReason> for Staged {
    fn from(reason: CloseReason) -> Self {
        Self::Close(reason)
    }
}

impl FrameTx {
    pub(crate) fn new(carrier: &Arc<Carrier>) -> Self {
        Self { lane: UnitTx::new(carrier, LANE), staged: VecDeque::new(), warned: false }
    }

    pub(crate) fn stage(&mut self, message: impl Into<Staged>, shared: &Shared) {
        let message = message.into();
        let (kind, bytes) = match &message {
            Staged::Frame(message) => (message.kind(), message.payload()),
            Staged::Close(_) => (Kind::Close, 0),
        };
        shared.counters.sent.count(kind, bytes);
        self.staged.push_back(message);
    }

    /// The newest frame that the peer has completely.
    pub(crate) fn confirmed(&self) -> Option<FrameNumber> {
        self.lane.carrier.lock().connection.confirmed_frame()
    }

    /// Passes staged messages to the connection. Any progress restarts the timeout.
    pub(crate) async fn send_staged(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        while !self.staged.is_empty() {
            let Self { lane, staged, warned } = self;
            let mut late = None;
            let put = |state: &mut State| {
                let connection = &mut state.connection;
                while connection.is_writable(LANE)
                    && let Some(message) = staged.pop_front()
                {
                    match message {
                        Staged::Frame(message) => connection.send(&message),
                        Staged::Close(reason) => connection.end_lane(LANE, reason),
                    }
                }
                late = connection.deadline_too_short().filter(|_| !*warned);
            };
            lane.with_room(timeouts, put).await?;
            if let Some(DeadlineTooShort { deadline, way }) = late {
                *warned = true;
                tracing::warn!(peer = %lane.carrier.port().remote(), ?way, ?deadline, "the way to the peer takes longer than a frame may: hardly any will come whole; take a longer deadline, or a link without one");
            }
        }
        Ok(())
    }

    /// Ends the lane behind its close, once everything has arrived.
    pub(crate) async fn close(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        self.lane.close(timeouts).await
    }
}

#[derive(Debug)]
pub(crate) struct FrameRx(UnitRx);

impl FrameRx {
    pub(crate) fn new(carrier: &Arc<Carrier>) -> Self {
        Self(UnitRx::new(carrier, LANE))
    }

    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<FrameMessage, LaneError> {
        match self.0.next(by, shared, timeouts).await? {
            Received::Frame(message) => {
                shared.counters.received.count(message.kind(), message.payload());
                Ok(message)
            }
            _ => Err(wrong_unit()),
        }
    }
}
