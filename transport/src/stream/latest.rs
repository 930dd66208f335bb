//! The latest lane over a byte stream of its own.

use std::sync::Arc;
use std::task::{Context, Poll};

use trimaran_wire::{CloseReason, FixedBytes, Lane, Message};

use super::source::{Sink, Source};
use super::writer::{Cell, Writer};
use crate::error::{LaneError, Loss, misplaced};
use crate::lanes::half::{Half, LaneTx, Rx, Tx};
use crate::stats::Counters;
use trimaran_net::Net;

/// How much is read at once: many values.
const ROOM: usize = 4 * 1024;

/// How many reads are drained in search of the newest value before it is returned, so that a flood cannot
/// hold the reader.
const READS: usize = 64;

/// A cell of size one: if the stream takes no more, each value replaces the waiting one.
#[derive(Debug)]
pub(crate) struct LatestTx(Writer);

impl LatestTx {
    pub(crate) fn new(net: &Arc<dyn Net>, sink: Sink, counters: &Arc<Counters>) -> Self {
        Self(Writer::new(net, sink, counters))
    }

    pub(super) fn cell(&self) -> &Arc<Cell> {
        self.0.cell()
    }
}

impl Half for LatestTx {}

impl LaneTx for LatestTx {
    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.0.close(reason)
    }

    fn poll_closed(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        self.0.poll_idle(cx)
    }
}

impl Tx<FixedBytes> for LatestTx {
    fn stage(&mut self, value: FixedBytes) -> Result<(), Loss> {
        self.0.send(Message::Latest(value))
    }
}

#[derive(Debug)]
pub(crate) struct LatestRx {
    source: Source,
    counters: Arc<Counters>,
    closed: Option<CloseReason>,
    /// The end of the lane behind a value that was returned first.
    ended: Option<LaneError>,
}

impl LatestRx {
    pub(crate) fn new(source: Source, counters: &Arc<Counters>) -> Self {
        let counters = Arc::clone(counters);
        Self { source: source.with_room(ROOM), counters, closed: None, ended: None }
    }

    /// Takes everything that has arrived; whether that was anything at all.
    fn drain(&mut self, cx: &mut Context<'_>, newest: &mut Option<FixedBytes>) -> Result<bool, LaneError> {
        if let Some(reason) = &self.closed {
            return Err(LaneError::Closed(reason.clone()));
        }
        let mut came = false;
        for _ in 0..READS {
            while let Some(message) = self.source.next_buffered(&self.counters.received)? {
                came = true;
                match message {
                    Message::Latest(value) => *newest = Some(value),
                    Message::KeepAlive => {}
                    Message::Close(reason) => {
                        self.closed = Some(reason.clone());
                        return Err(LaneError::Closed(reason));
                    }
                    other => return Err(misplaced(other.kind(), Lane::Latest)),
                }
            }
            match self.source.poll_fill(cx) {
                Poll::Ready(filled) => filled?,
                Poll::Pending => break,
            }
            came = true;
        }
        Ok(came)
    }
}

impl Half for LatestRx {}

impl Rx<FixedBytes> for LatestRx {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<FixedBytes>, LaneError>> {
        if let Some(end) = self.ended.take() {
            return Poll::Ready(Err(end));
        }
        let mut newest = None;
        let drained = self.drain(cx, &mut newest);
        match (drained, newest) {
            (Ok(false), None) => Poll::Pending,
            (Ok(_), newest) => Poll::Ready(Ok(newest)),
            (Err(end), None) => Poll::Ready(Err(end)),
            (Err(end), newest) => {
                self.ended = Some(end);
                Poll::Ready(Ok(newest))
            }
        }
    }
}
