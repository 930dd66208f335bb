//! The messages lane over datagrams.

use std::sync::Arc;

use bytes::Bytes;
use trimaran_udp::{LaneViolation, Received, UnitLane};
use trimaran_wire::{CloseReason, Kind};

use super::port::Carrier;
use super::units::{UnitRx, UnitTx};
use crate::error::{LaneError, LaneSendError, ProtocolError};
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

const LANE: UnitLane = UnitLane::Messages;

#[derive(Debug)]
pub(crate) struct MessageTx(UnitTx);

impl MessageTx {
    pub(crate) fn new(carrier: &Arc<Carrier>) -> Self {
        Self(UnitTx::new(carrier, LANE))
    }

    pub(crate) async fn send(
        &mut self,
        message: Bytes,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        let bytes = message.len();
        self.0.with_room(timeouts, |state| state.connection.say(message.clone())).await?;
        shared.counters.sent.count(Kind::Message, bytes);
        Ok(())
    }

    /// Closes the lane, and waits until all of it has arrived.
    pub(crate) async fn close(
        &mut self,
        reason: CloseReason,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.0.with_room(timeouts, |state| state.connection.end_lane(LANE, reason.clone())).await?;
        shared.counters.sent.count(Kind::Close, 0);
        self.0.close(timeouts).await
    }
}

#[derive(Debug)]
pub(crate) struct MessageRx(UnitRx);

impl MessageRx {
    pub(crate) fn new(carrier: &Arc<Carrier>) -> Self {
        Self(UnitRx::new(carrier, LANE))
    }

    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<Bytes, LaneError> {
        match self.0.next(by, shared, timeouts).await? {
            Received::Message(bytes) => {
                shared.counters.received.count(Kind::Message, bytes.len());
                Ok(bytes)
            }
            _ => Err(wrong_unit()),
        }
    }
}

/// A unit that belongs on another lane: the connection would have ended with it.
pub(super) fn wrong_unit() -> LaneError {
    let violation = LaneViolation::Unit;
    LaneError::Protocol(ProtocolError::Datagrams(Box::new(violation.into())))
}
