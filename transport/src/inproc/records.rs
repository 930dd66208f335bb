//! A lane of records, messages or blocks, as a bounded queue without encoding.

use tokio::sync::mpsc;
use trimaran_wire::{CloseReason, Kind};

use crate::error::{LaneError, LaneSendError, Loss};
use crate::lanes::records::RecordLane;
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

/// How many records may wait for their reader: of blocks 1 MiB at most.
const QUEUE: usize = 64;

/// Entries of the queue.
#[derive(Debug)]
enum Said<T> {
    /// A record, and its size if it were encoded.
    Record(T, usize),
    Close(CloseReason),
}

#[derive(Debug)]
pub(crate) struct RecordTx<T> {
    lane: RecordLane,
    queue: mpsc::Sender<Said<T>>,
}

#[derive(Debug)]
pub(crate) struct RecordRx<T> {
    lane: RecordLane,
    queue: mpsc::Receiver<Said<T>>,
    closed: Option<CloseReason>,
}

/// The lane in one direction.
pub(super) fn records<T>(lane: RecordLane) -> (RecordTx<T>, RecordRx<T>) {
    let (queue, said) = mpsc::channel(QUEUE);
    (RecordTx { lane, queue }, RecordRx { lane, queue: said, closed: None })
}

impl<T> RecordTx<T> {
    /// Sends a record of this encoded size.
    pub(crate) async fn send(
        &mut self,
        record: T,
        bytes: usize,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.say(Said::Record(record, bytes), timeouts).await?;
        shared.counters.sent.count(self.lane.kind(), bytes);
        Ok(())
    }

    pub(crate) async fn close(
        &mut self,
        reason: CloseReason,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.say(Said::Close(reason), timeouts).await?;
        shared.counters.sent.count(Kind::Close, 0);
        Ok(())
    }

    async fn say(&self, said: Said<T>, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        let sent = timeouts.wait(None, self.queue.send(said)).await.map_err(|_| LaneSendError::Stalled)?;
        sent.map_err(|_gone| LaneSendError::Lost(Loss::Closed))
    }
}

impl<T> RecordRx<T> {
    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<T, LaneError> {
        if let Some(reason) = &self.closed {
            return Err(LaneError::Closed(reason.clone()));
        }
        let said = timeouts.wait(by, self.queue.recv()).await.map_err(LaneError::Expired)?;
        match said.ok_or(LaneError::Lost(Loss::Closed))? {
            Said::Record(record, bytes) => {
                shared.counters.received.count(self.lane.kind(), bytes);
                Ok(record)
            }
            Said::Close(reason) => {
                shared.counters.received.count(Kind::Close, 0);
                self.closed = Some(reason.clone());
                Err(LaneError::Closed(reason))
            }
        }
    }
}
