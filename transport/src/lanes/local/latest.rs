//! The latest lane within this process: a cell behind a mutex.

use parking_lot::Mutex;
use std::fmt;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use trimaran_wire::{CloseReason, Format, Kind};

use crate::error::{LaneError, Loss};
use crate::lanes::half::{Half, LaneTx, Rx, Tx};
use crate::stats::{Counters, Direction};

/// The lane in one direction.
pub(super) fn latest<V>(
    format: &Format,
    [sent, received]: [&Arc<Counters>; 2],
) -> (LatestTx<V>, LatestRx<V>) {
    let cell = Arc::new(Mutex::new(Cell { value: None, closed: None, ended: false, reader: None }));
    let (sent, received) = (Arc::clone(sent), Arc::clone(received));
    let bytes = format.latest;
    let tx = LatestTx { cell: Arc::clone(&cell), bytes, counters: sent };
    (tx, LatestRx { cell, bytes, counters: received })
}

#[derive(Debug)]
struct Cell<V> {
    /// Published, and not read.
    value: Option<V>,
    closed: Option<CloseReason>,
    /// One of the ends is gone.
    ended: bool,
    /// Waits for a value.
    reader: Option<Waker>,
}

#[derive(Debug)]
pub(super) struct LatestTx<V> {
    cell: Arc<Mutex<Cell<V>>>,
    /// The size of a value.
    bytes: usize,
    counters: Arc<Counters>,
}

impl<V> LatestTx<V> {
    fn change(&self, change: impl FnOnce(&mut Cell<V>, &Direction)) -> Result<(), Loss> {
        let mut cell = self.cell.lock();
        if cell.ended {
            return Err(Loss::Closed);
        }
        change(&mut cell, &self.counters.sent);
        let reader = cell.reader.take();
        drop(cell);
        if let Some(reader) = reader {
            reader.wake();
        }
        Ok(())
    }
}

impl<V: fmt::Debug + Send> Half for LatestTx<V> {}

impl<V: fmt::Debug + Send> LaneTx for LatestTx<V> {
    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.change(|cell, sent| {
            sent.count(Kind::Close, 0);
            cell.closed = Some(reason);
        })
    }
}

impl<V: fmt::Debug + Send> Tx<V> for LatestTx<V> {
    fn stage(&mut self, value: V) -> Result<(), Loss> {
        let bytes = self.bytes;
        self.change(|cell, sent| {
            sent.count(Kind::Latest, bytes);
            cell.value = Some(value);
        })
    }
}

impl<V> Drop for LatestTx<V> {
    fn drop(&mut self) {
        let _gone = self.change(|cell, _| cell.ended = true);
    }
}

#[derive(Debug)]
pub(super) struct LatestRx<V> {
    cell: Arc<Mutex<Cell<V>>>,
    /// The size of a value.
    bytes: usize,
    counters: Arc<Counters>,
}

impl<V: fmt::Debug + Send> Half for LatestRx<V> {}

impl<V: fmt::Debug + Send> Rx<V> for LatestRx<V> {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<V>, LaneError>> {
        let mut cell = self.cell.lock();
        if let Some(value) = cell.value.take() {
            self.counters.received.count(Kind::Latest, self.bytes);
            return Poll::Ready(Ok(Some(value)));
        }
        match &cell.closed {
            Some(reason) => Poll::Ready(Err(LaneError::Closed(reason.clone()))),
            None if cell.ended => Poll::Ready(Err(LaneError::Lost(Loss::Closed))),
            None => {
                cell.reader = Some(cx.waker().clone());
                Poll::Pending
            }
        }
    }
}

impl<V> Drop for LatestRx<V> {
    fn drop(&mut self) {
        self.cell.lock().ended = true;
    }
}
