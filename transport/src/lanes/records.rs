//! The common part of the messages lane and the bulk lane. Each carries records: strings of bytes that arrive
//! once, whole, and in the order in which they were sent, or the link ends.

use bytes::Bytes;
use trimaran_net::Instant;
use trimaran_wire::{CloseReason, Kind, Lane, Message};

use crate::error::{LaneError, LaneSendError, ProtocolError, RecvError, SendError, misplaced};
use crate::inproc::records as inproc;
use crate::lanes::shared::{Shared, at_once};
#[cfg(feature = "quic")]
use crate::quic::records as quic;
use crate::rates::Messages;
use crate::stream::records as stream;
use crate::timeouts::Timeouts;
#[cfg(feature = "udp")]
use crate::udp::records as udp;

/// One of the lanes of records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RecordLane {
    /// A record is a message.
    Messages,
    /// A record is a block.
    Bulk,
}

impl RecordLane {
    /// The kind of the lane's records.
    pub(crate) const fn kind(self) -> Kind {
        match self {
            Self::Messages => Kind::Message,
            Self::Bulk => Kind::Block,
        }
    }

    /// The message for a record.
    pub(crate) const fn message(self, record: Bytes) -> Message {
        match self {
            Self::Messages => Message::Message(record),
            Self::Bulk => Message::Block(record),
        }
    }

    /// The record in `message`.
    pub(crate) fn record(self, message: Message) -> Result<Bytes, LaneError> {
        match (self, message) {
            (Self::Messages, Message::Message(record)) | (Self::Bulk, Message::Block(record)) => Ok(record),
            (Self::Messages, other) => Err(misplaced(other.kind(), Lane::Messages)),
            (Self::Bulk, other) => Err(misplaced(other.kind(), Lane::Bulk)),
        }
    }
}

over_bytes!(WireRecordTx: RecordTx);
over_bytes!(WireRecordRx: RecordRx);

#[derive(Debug)]
pub(crate) enum RecordTx<T> {
    Local(inproc::RecordTx<T>),
    Wire(WireRecordTx),
}

#[derive(Debug)]
pub(crate) enum RecordRx<T> {
    Local(inproc::RecordRx<T>),
    Wire(WireRecordRx),
}

/// Sends records.
#[derive(Debug)]
pub(crate) struct RecordSender<T> {
    pub(crate) lane: RecordTx<T>,
    pub(crate) shared: Shared,
    pub(crate) timeouts: Timeouts,
}

impl<T> RecordSender<T> {
    /// Sends a record. Within one process `local` gives it, with its encoded size; otherwise `wire` gives its
    /// bytes. Either returns nothing for a record that is too long.
    pub(crate) async fn send(
        &mut self,
        local: impl FnOnce() -> Option<(T, usize)>,
        wire: impl FnOnce() -> Option<Bytes>,
    ) -> Result<(), SendError> {
        let Self { lane, shared, timeouts } = self;
        let too_long = || SendError::TooLong { peer: shared.peer.clone() };
        let sent = match lane {
            RecordTx::Local(lane) => {
                let (record, bytes) = local().ok_or_else(too_long)?;
                lane.send(record, bytes, shared, timeouts).await
            }
            RecordTx::Wire(lane) => {
                let record = wire().ok_or_else(too_long)?;
                whichever!(WireRecordTx: lane, lane => lane.send(record, shared, timeouts).await)
            }
        };
        sent.map_err(|e| self.error(e))
    }

    pub(crate) async fn close(mut self, reason: CloseReason) -> Result<(), SendError> {
        let (shared, timeouts) = (&self.shared, &mut self.timeouts);
        match &mut self.lane {
            RecordTx::Local(lane) => lane.close(reason, shared, timeouts).await,
            RecordTx::Wire(lane) => {
                whichever!(WireRecordTx: lane, lane => lane.close(reason, shared, timeouts).await)
            }
        }
        .map_err(|e| self.error(e))
    }

    fn error(&self, error: LaneSendError) -> SendError {
        error.sending(&self.shared.peer, self.timeouts.limit())
    }
}

/// Receives records.
#[derive(Debug)]
pub(crate) struct RecordReceiver<T> {
    pub(crate) lane: RecordRx<T>,
    pub(crate) shared: Shared,
    /// Without a limit to a wait.
    pub(crate) timeouts: Timeouts,
    /// The message rate limit, where messages are counted.
    pub(crate) rate: Option<Messages>,
    /// Decodes a record.
    pub(crate) read: fn(Bytes) -> Result<T, ProtocolError>,
}

impl<T> RecordReceiver<T> {
    /// Waits for the next record, until `by` at most if that is given. Dropping the future loses nothing.
    pub(crate) async fn recv(&mut self, by: Option<Instant>) -> Result<T, RecvError> {
        let Self { lane, shared, timeouts, rate, read } = self;
        let record = match lane {
            RecordRx::Local(lane) => lane.next(by, shared, timeouts).await,
            RecordRx::Wire(lane) => {
                { whichever!(WireRecordRx: lane, lane => lane.next(by, shared, timeouts).await) }.and_then(
                    |bytes| {
                        if let Some(rate) = rate {
                            rate.count(|| timeouts.now()).map_err(|e| {
                                shared.counters.flooded();
                                LaneError::Protocol(ProtocolError::TooMany(e))
                            })?;
                        }
                        read(bytes).map_err(LaneError::Protocol)
                    },
                )
            }
        };
        record.map_err(|e| e.receiving(&self.shared.peer, self.timeouts.limit()))
    }

    /// The next record if it has arrived.
    pub(crate) fn try_recv(&mut self) -> Result<Option<T>, RecvError> {
        at_once(self.recv(None))
    }

    /// Discards everything until the lane ends, and returns how it ended.
    pub(crate) async fn drain(&mut self) -> RecvError {
        loop {
            if let Err(end) = self.recv(None).await {
                return end;
            }
        }
    }
}
