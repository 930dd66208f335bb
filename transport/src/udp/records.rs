//! A lane of records, messages or blocks, over datagrams.

use std::sync::Arc;
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use trimaran_udp::{LaneViolation, Received, UnitLane};
use trimaran_wire::{CloseReason, Kind};

use super::port::Carrier;
use super::units::{UnitRx, UnitTx};
use crate::error::{LaneError, Loss, ProtocolError};
use crate::lanes::half::{Half, LaneTx, Rx, Tx};
use crate::lanes::records::RecordLane;
use crate::stats::Counters;

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
    counters: Arc<Counters>,
}

impl RecordTx {
    pub(crate) fn new(carrier: &Arc<Carrier>, lane: RecordLane, counters: &Arc<Counters>) -> Self {
        Self { lane, units: UnitTx::new(carrier, lane.units()), counters: Arc::clone(counters) }
    }
}

impl Half for RecordTx {}

impl LaneTx for RecordTx {
    fn poll_send(&mut self, cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        Poll::Ready(ready!(self.units.poll_room(cx, |_| {})).map(|()| true))
    }

    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.units.put(|state| state.connection.end_lane(self.lane.units(), reason));
        self.counters.sent.count(Kind::Close, 0);
        Ok(())
    }

    fn poll_closed(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        self.units.poll_closed(cx)
    }
}

impl Tx<Bytes> for RecordTx {
    fn stage(&mut self, record: Bytes) -> Result<(), Loss> {
        let bytes = record.len();
        self.units.put(|state| match self.lane {
            RecordLane::Messages => state.connection.say(record),
            RecordLane::Bulk => state.connection.carry(record),
        });
        self.counters.sent.count(self.lane.kind(), bytes);
        Ok(())
    }
}

#[derive(Debug)]
pub(crate) struct RecordRx {
    lane: RecordLane,
    units: UnitRx,
}

impl RecordRx {
    pub(crate) fn new(carrier: &Arc<Carrier>, lane: RecordLane, counters: &Arc<Counters>) -> Self {
        Self { lane, units: UnitRx::new(carrier, lane.units(), counters) }
    }
}

impl Half for RecordRx {}

impl Rx<Bytes> for RecordRx {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<Bytes>, LaneError>> {
        // Each kind comes on its own lane only.
        Poll::Ready(match ready!(self.units.poll_next(cx))? {
            Received::Message(record) | Received::Block(record) => {
                self.units.counters().received.count(self.lane.kind(), record.len());
                Ok(Some(record))
            }
            _ => Err(wrong_unit()),
        })
    }
}

/// A unit of another lane: the connection would have ended with it.
pub(super) fn wrong_unit() -> LaneError {
    let violation = LaneViolation::Unit;
    LaneError::Protocol(ProtocolError::Datagrams(Box::new(violation.into())))
}
