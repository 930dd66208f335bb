//! A lane of records, messages or blocks, over datagrams.

use std::sync::Arc;

use bytes::Bytes;
use trimaran_udp::{LaneViolation, Received, UnitLane};
use trimaran_wire::{CloseReason, Kind};

use super::port::{Carrier, State};
use super::units::{UnitRx, UnitTx};
use crate::error::{LaneError, LaneSendError, ProtocolError};
use crate::lanes::records::RecordLane;
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

impl RecordLane {
    /// The lane of its units.
    const fn units(self) -> UnitLane {
        match self {
            Self::Messages => UnitLane::Messages,
            Self::Bulk => UnitLane::Bulk,
        }
    }
}

#[derive(Debug)]
pub(crate) struct RecordTx {
    lane: RecordLane,
    units: UnitTx,
}

impl RecordTx {
    pub(crate) fn new(carrier: &Arc<Carrier>, lane: RecordLane) -> Self {
        Self { lane, units: UnitTx::new(carrier, lane.units()) }
    }

    pub(crate) async fn send(
        &mut self,
        record: Bytes,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        let (lane, bytes) = (self.lane, record.len());
        let put = |state: &mut State| match lane {
            RecordLane::Messages => state.connection.say(record.clone()),
            RecordLane::Bulk => state.connection.carry(record.clone()),
        };
        self.units.with_room(timeouts, put).await?;
        shared.counters.sent.count(lane.kind(), bytes);
        Ok(())
    }

    /// Closes the lane, and waits until everything has arrived.
    pub(crate) async fn close(
        &mut self,
        reason: CloseReason,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        let lane = self.lane.units();
        self.units.with_room(timeouts, |state| state.connection.end_lane(lane, reason.clone())).await?;
        shared.counters.sent.count(Kind::Close, 0);
        self.units.close(timeouts).await
    }
}

#[derive(Debug)]
pub(crate) struct RecordRx {
    lane: RecordLane,
    units: UnitRx,
}

impl RecordRx {
    pub(crate) fn new(carrier: &Arc<Carrier>, lane: RecordLane) -> Self {
        Self { lane, units: UnitRx::new(carrier, lane.units()) }
    }

    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<Bytes, LaneError> {
        // Each kind comes on its own lane only.
        match self.units.next(by, shared, timeouts).await? {
            Received::Message(record) | Received::Block(record) => {
                shared.counters.received.count(self.lane.kind(), record.len());
                Ok(record)
            }
            _ => Err(wrong_unit()),
        }
    }
}

/// A unit of another lane: the connection would have ended with it.
pub(super) fn wrong_unit() -> LaneError {
    let violation = LaneViolation::Unit;
    LaneError::Protocol(ProtocolError::Datagrams(Box::new(violation.into())))
}
