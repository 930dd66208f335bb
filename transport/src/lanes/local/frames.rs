//! The frames lane within this process.

use std::collections::VecDeque;
use std::fmt;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use trimaran_wire::{CloseReason, Format, FrameEvent, Kind, Protocol};

use super::Said;
use crate::error::{LaneError, Loss};
use crate::lanes::half::{Half, LaneTx, Rx, Tx};
use crate::lanes::queue::{Gone, Receiver, Sender, queue};
use crate::stats::Counters;

/// The most messages of the frames lane that may wait for their reader, and that it may have taken at once:
/// for items of 4 bytes 32 MiB in all at the largest batch size.
const QUEUE: usize = 256;

/// The kind and payload size of data if it were encoded. A begin has so many bytes.
type Weight<T> = fn(&T, usize) -> (Kind, usize);

/// The lane of `T` in one direction.
pub(super) fn frames<T>(
    format: &Format,
    [sent, received]: [&Arc<Counters>; 2],
    weight: Weight<T>,
) -> (FrameTx<T>, FrameRx<T>) {
    let ((sender, receiver), begin) = (queue(QUEUE), format.begin());
    let tx = FrameTx { weight, begin, queue: sender, staged: VecDeque::new(), counters: Arc::clone(sent) };
    (tx, FrameRx { weight, begin, queue: receiver, closed: None, counters: Arc::clone(received) })
}

#[derive(Debug)]
pub(super) struct FrameTx<T> {
    weight: Weight<T>,
    /// The size of a begin.
    begin: usize,
    queue: Sender<Said<T>>,
    staged: VecDeque<Said<T>>,
    counters: Arc<Counters>,
}

#[derive(Debug)]
pub(super) struct FrameRx<T> {
    weight: Weight<T>,
    queue: Receiver<Said<T>>,
    closed: Option<CloseReason>,
    /// The size of a begin.
    begin: usize,
    counters: Arc<Counters>,
}

impl<T: fmt::Debug + Send> Half for FrameTx<T> {}

impl<T: fmt::Debug + Send> LaneTx for FrameTx<T> {
    fn poll_send(&mut self, cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        if self.staged.is_empty() {
            return Poll::Ready(Ok(true));
        }
        ready!(self.queue.poll_send(&mut self.staged, cx)).map_err(|Gone| Loss::Closed)?;
        Poll::Ready(Ok(self.staged.is_empty()))
    }

    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.counters.sent.count(Kind::Close, 0);
        self.staged.push_back(Said::Close(reason));
        Ok(())
    }
}

impl<T: fmt::Debug + Send> Tx<T> for FrameTx<T> {
    fn stage(&mut self, data: T) -> Result<(), Loss> {
        let (kind, bytes) = (self.weight)(&data, self.begin);
        self.counters.sent.count(kind, bytes);
        self.staged.push_back(Said::Data(data));
        Ok(())
    }
}

impl<T: fmt::Debug + Send> Half for FrameRx<T> {}

impl<T: fmt::Debug + Send> Rx<T> for FrameRx<T> {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<T>, LaneError>> {
        let next = super::poll_next(&mut self.queue, &mut self.closed, &self.counters, cx);
        next.map_ok(|data| {
            let (kind, bytes) = (self.weight)(&data, self.begin);
            self.counters.received.count(kind, bytes);
            Some(data)
        })
    }
}

/// The kind and payload size of an event if it were encoded.
pub(super) fn weight<P: Protocol>(event: &FrameEvent<P>, begin: usize) -> (Kind, usize) {
    match event {
        FrameEvent::Begin(_) => (Kind::Begin, begin),
        FrameEvent::Batch(batch) => (Kind::Batch, batch.as_bytes().len()),
        FrameEvent::End(_) => (Kind::End, 16),
    }
}
