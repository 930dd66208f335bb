//! A lane of records, messages or blocks, within this process.

use std::fmt;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use trimaran_wire::{CloseReason, Kind};

use super::Said;
use crate::error::{LaneError, Loss};
use crate::lanes::half::{Duplex, Half, LaneTx, Rx, Tx};
use crate::lanes::queue::{Gone, Receiver, Sender, queue};
use crate::lanes::records::{Measured, RecordLane};
use crate::stats::Counters;

/// How many records may wait for their reader, and that it may have taken at once: of blocks 1 MiB in all.
const QUEUE: usize = 32;

#[derive(Debug)]
struct RecordTx<T> {
    lane: RecordLane,
    queue: Sender<Said<Measured<T>>>,
    counters: Arc<Counters>,
}

#[derive(Debug)]
struct RecordRx<T> {
    lane: RecordLane,
    queue: Receiver<Said<Measured<T>>>,
    closed: Option<CloseReason>,
    counters: Arc<Counters>,
}

/// Both ends of the lane.
pub(super) fn records<T: fmt::Debug + Send + 'static>(
    lane: RecordLane,
    [here, there]: [&Arc<Counters>; 2],
) -> [Duplex<Measured<T>>; 2] {
    let way = |from: &Arc<Counters>, to: &Arc<Counters>| {
        let (sender, receiver) = queue(QUEUE);
        let tx = Box::new(RecordTx { lane, queue: sender, counters: Arc::clone(from) });
        (tx, Box::new(RecordRx { lane, queue: receiver, closed: None, counters: Arc::clone(to) }))
    };
    let ((near_tx, far_rx), (far_tx, near_rx)) = (way(here, there), way(there, here));
    [(near_tx, near_rx), (far_tx, far_rx)]
}

impl<T> RecordTx<T> {
    fn say(&self, said: Said<Measured<T>>, kind: Kind, bytes: usize) -> Result<(), Loss> {
        self.queue.push(said).map_err(|Gone| Loss::Closed)?;
        self.counters.sent.count(kind, bytes);
        Ok(())
    }
}

impl<T: fmt::Debug + Send> Half for RecordTx<T> {}

impl<T: fmt::Debug + Send> LaneTx for RecordTx<T> {
    fn poll_send(&mut self, cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        Poll::Ready(ready!(self.queue.poll_room(cx)).map(|()| true).map_err(|Gone| Loss::Closed))
    }

    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.say(Said::Close(reason), Kind::Close, 0)
    }
}

impl<T: fmt::Debug + Send> Tx<Measured<T>> for RecordTx<T> {
    fn stage(&mut self, record: Measured<T>) -> Result<(), Loss> {
        let bytes = record.1;
        self.say(Said::Data(record), self.lane.kind(), bytes)
    }
}

impl<T: fmt::Debug + Send> Half for RecordRx<T> {}

impl<T: fmt::Debug + Send> Rx<Measured<T>> for RecordRx<T> {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<Measured<T>>, LaneError>> {
        let next = super::poll_next(&mut self.queue, &mut self.closed, &self.counters, cx);
        next.map_ok(|record| {
            self.counters.received.count(self.lane.kind(), record.1);
            Some(record)
        })
    }
}
