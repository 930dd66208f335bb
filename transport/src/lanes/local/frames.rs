//! The frames lane within this process.

use std::collections::VecDeque;
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

/// The lane in one direction.
pub(super) fn frames<P: Protocol>([sent, received]: [&Arc<Counters>; 2]) -> (FrameTx<P>, FrameRx<P>) {
    let (sender, receiver) = queue(QUEUE);
    let tx = FrameTx { queue: sender, staged: VecDeque::new(), counters: Arc::clone(sent) };
    (tx, FrameRx { queue: receiver, closed: None, counters: Arc::clone(received) })
}

#[derive(Debug)]
pub(super) struct FrameTx<P: Protocol> {
    queue: Sender<Said<FrameEvent<P>>>,
    staged: VecDeque<Said<FrameEvent<P>>>,
    counters: Arc<Counters>,
}

#[derive(Debug)]
pub(super) struct FrameRx<P: Protocol> {
    queue: Receiver<Said<FrameEvent<P>>>,
    closed: Option<CloseReason>,
    counters: Arc<Counters>,
}

impl<P: Protocol> Half for FrameTx<P> {}

impl<P: Protocol> LaneTx for FrameTx<P> {
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

impl<P: Protocol> Tx<FrameEvent<P>> for FrameTx<P> {
    fn stage(&mut self, event: FrameEvent<P>) -> Result<(), Loss> {
        let (kind, bytes) = weight(&event);
        self.counters.sent.count(kind, bytes);
        self.staged.push_back(Said::Data(event));
        Ok(())
    }
}

impl<P: Protocol> Half for FrameRx<P> {}

impl<P: Protocol> Rx<FrameEvent<P>> for FrameRx<P> {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<FrameEvent<P>>, LaneError>> {
        let next = super::poll_next(&mut self.queue, &mut self.closed, &self.counters, cx);
        next.map_ok(|event| {
            let (kind, bytes) = weight(&event);
            self.counters.received.count(kind, bytes);
            Some(event)
        })
    }
}

/// The kind and payload size of an event if it were encoded.
fn weight<P: Protocol>(event: &FrameEvent<P>) -> (Kind, usize) {
    match event {
        FrameEvent::Begin(_) => (Kind::Begin, Format::of::<P>().begin()),
        FrameEvent::Batch(batch) => (Kind::Batch, batch.as_bytes().len()),
        FrameEvent::End(_) => (Kind::End, 16),
    }
}
