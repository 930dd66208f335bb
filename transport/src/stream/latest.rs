//! The latest lane over a byte stream of its own.

use std::future::poll_fn;
use std::mem;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use trimaran_wire::{CloseReason, FixedBytes, Lane, Message};

use super::source::{Sink, Source};
use super::writer::{Cell, Writer};
use crate::error::{LaneError, LaneSendError, misplaced};
use crate::lanes::shared::Shared;
use crate::stats::Counters;
use crate::timeouts::{Timeouts, Wait};
use trimaran_net::{Instant, Net};

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

    pub(crate) fn publish(&mut self, value: FixedBytes, _: &Shared) -> Result<(), LaneSendError> {
        self.0.send(Message::Latest(value))
    }

    pub(crate) async fn close(
        &mut self,
        reason: CloseReason,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.0.close(reason, timeouts).await
    }
}

#[derive(Debug)]
pub(crate) struct LatestRx {
    source: Source,
    closed: Option<CloseReason>,
    /// The end of the lane behind a value that was returned first.
    ended: Option<LaneError>,
    /// Something has come that the timeouts have not counted.
    heard: bool,
}

impl LatestRx {
    pub(crate) fn new(source: Source) -> Self {
        Self { source: source.with_room(ROOM), closed: None, ended: None, heard: false }
    }

    pub(crate) fn try_latest(&mut self, shared: &Shared) -> Result<Option<FixedBytes>, LaneError> {
        if let Some(end) = self.ended.take() {
            return Err(end);
        }
        let mut newest = None;
        match self.drain(shared, &mut newest) {
            Ok(()) => Ok(newest),
            Err(end) if newest.is_some() => {
                self.ended = Some(end);
                Ok(newest)
            }
            Err(end) => Err(end),
        }
    }

    pub(crate) async fn latest(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<FixedBytes, LaneError> {
        let mut wait = Wait::default();
        loop {
            let value = self.try_latest(shared)?;
            if mem::take(&mut self.heard) {
                timeouts.heard();
            }
            if let Some(value) = value {
                return Ok(value);
            }
            timeouts
                .hear(&mut wait, by, poll_fn(|cx| self.source.poll_fill(cx)))
                .await
                .map_err(LaneError::Expired)??;
        }
    }

    /// Takes everything that has arrived.
    fn drain(&mut self, shared: &Shared, newest: &mut Option<FixedBytes>) -> Result<(), LaneError> {
        if let Some(reason) = &self.closed {
            return Err(LaneError::Closed(reason.clone()));
        }
        for _ in 0..READS {
            while let Some(message) = self.source.next_buffered(&shared.counters.received)? {
                self.heard = true;
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
            match self.source.poll_fill(&mut Context::from_waker(Waker::noop())) {
                Poll::Ready(filled) => filled?,
                Poll::Pending => break,
            }
        }
        Ok(())
    }
}
