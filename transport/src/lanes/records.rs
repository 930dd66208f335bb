//! The common part of the messages lane and the bulk lane. Each carries records: strings of bytes that arrive
//! once, whole, and in the order in which they were sent, or the link ends.

use bytes::Bytes;
use trimaran_net::Instant;
use trimaran_wire::{Kind, Lane, Message};

use super::ends::{AnyTx, Came, Receiver, Sender, at_once, lost};
use crate::error::{LaneError, ProtocolError, RecvError, SendError, misplaced};
use crate::rates::Messages;

/// A record within this process, and its size if it were encoded.
pub(crate) type Measured<T> = (T, usize);

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

/// Sends records.
pub(crate) type RecordSender<T> = Sender<Measured<T>, Bytes>;

impl<T> RecordSender<T> {
    /// Sends a record. Within one process `local` gives it, with its encoded size; otherwise `wire` gives its
    /// bytes. Either returns nothing for a record that is too long.
    pub(crate) async fn send(
        &mut self,
        local: impl FnOnce() -> Option<Measured<T>>,
        wire: impl FnOnce() -> Option<Bytes>,
    ) -> Result<(), SendError> {
        let record = match &self.lane {
            AnyTx::Local(_) => local().map(Came::Local),
            AnyTx::Wire(_) => wire().map(Came::Wire),
        };
        let record = record.ok_or_else(|| SendError::TooLong { peer: self.shared.peer.clone() })?;
        self.send_staged().await?;
        match (&mut self.lane, record) {
            (AnyTx::Local(lane), Came::Local(record)) => lane.stage(record),
            (AnyTx::Wire(lane), Came::Wire(record)) => lane.stage(record),
            // The lane stays what it is.
            _ => Ok(()),
        }
        .map_err(|loss| lost(loss, &self.shared))
    }
}

/// Receives records.
#[derive(Debug)]
pub(crate) struct RecordReceiver<T> {
    /// Without a limit to a wait.
    pub(crate) lane: Receiver<Measured<T>, Bytes>,
    /// The message rate limit, where messages are counted.
    pub(crate) rate: Option<Messages>,
    /// Decodes a record.
    pub(crate) read: fn(Bytes) -> Result<T, ProtocolError>,
}

impl<T> RecordReceiver<T> {
    /// Waits for the next record, until `by` at most if that is given. Dropping the future loses nothing.
    pub(crate) async fn recv(&mut self, by: Option<Instant>) -> Result<T, RecvError> {
        let Self { lane, rate, read } = self;
        match lane.next(by).await? {
            Came::Local((record, _)) => Ok(record),
            Came::Wire(bytes) => {
                rate.as_mut().map_or(Ok(()), |rate| lane.count(rate)).and_then(|()| read(bytes))
            }
        }
        .map_err(|e| LaneError::Protocol(e).receiving(&lane.shared.peer))
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
