//! The latest lane over a byte stream of its own.

use std::future::poll_fn;
use std::io;
use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker, ready};

use tokio::sync::Notify;
use trimaran_wire::{CloseReason, FixedBytes, Lane, Message};

use super::pulse::Pulse;
use super::source::{Sink, Source};
use crate::error::{LaneError, LaneSendError, Loss, misplaced};
use crate::link::Shared;
use crate::timeouts::{Timeouts, Wait};
use trimaran_net::{Instant, Net};

/// How much is read at once: many values.
const ROOM: usize = 4 * 1024;

/// How many reads are drained in search of the newest value before it is handed out, so that a flood cannot
/// hold the reader.
const READS: usize = 64;

/// Writes each value straight from the publishing thread. Only when the stream takes no more does a task
/// take over, and the cell of size one fills.
#[derive(Debug)]
pub(crate) struct LatestTx {
    net: Arc<dyn Net>,
    cell: Arc<Cell>,
}

#[derive(Debug)]
pub(super) struct Cell {
    outgoing: Mutex<Outgoing>,
    /// Rings when the task is done.
    idle: Notify,
    shared: Shared,
}

#[derive(Debug)]
struct Outgoing {
    sink: Sink,
    /// The newest value, while older bytes are still being written.
    newest: Option<FixedBytes>,
    closed: Option<CloseReason>,
    /// A keep-alive is due.
    alive: bool,
    /// Something was said since the last beat.
    spoke: bool,
    /// Nothing follows the closed.
    left: bool,
    /// A task writes; nobody else may, because a stream wakes only who polled it last.
    busy: bool,
    failed: Option<io::ErrorKind>,
}

impl LatestTx {
    pub(crate) fn new(net: &Arc<dyn Net>, sink: Sink, shared: Shared) -> Self {
        let outgoing = Outgoing {
            sink,
            newest: None,
            closed: None,
            alive: false,
            spoke: false,
            left: false,
            busy: false,
            failed: None,
        };
        let cell = Cell { outgoing: Mutex::new(outgoing), idle: Notify::new(), shared };
        Self { net: Arc::clone(net), cell: Arc::new(cell) }
    }

    pub(super) fn cell(&self) -> &Arc<Cell> {
        &self.cell
    }

    pub(crate) fn publish(&mut self, value: FixedBytes, _: &Shared) -> Result<(), LaneSendError> {
        self.send(|outgoing| outgoing.newest = Some(value))
    }

    pub(crate) async fn close(
        &mut self,
        reason: CloseReason,
        timeouts: &mut Timeouts,
    ) -> Result<(), LaneSendError> {
        self.send(|outgoing| {
            outgoing.closed = Some(reason);
            outgoing.left = true;
        })?;
        loop {
            // Made before the look, so that a task that ends in between is not missed.
            let idle = self.cell.idle.notified();
            {
                let outgoing = self.cell.lock();
                outgoing.check()?;
                if !outgoing.busy {
                    return Ok(());
                }
            }
            timeouts.wait(None, idle).await.map_err(|_| LaneSendError::Stalled)?;
        }
    }

    fn send(&self, put: impl FnOnce(&mut Outgoing)) -> Result<(), LaneSendError> {
        let mut outgoing = self.cell.lock();
        outgoing.check()?;
        put(&mut outgoing);
        outgoing.spoke = true;
        if outgoing.busy {
            return Ok(());
        }
        if self.cell.poll_send(&mut outgoing, &mut Context::from_waker(Waker::noop())).is_pending() {
            outgoing.busy = true;
            drop(outgoing);
            let cell = Arc::clone(&self.cell);
            self.net.spawn(Box::pin(async move { cell.send_all().await }));
            return Ok(());
        }
        outgoing.check()
    }
}

impl Cell {
    fn lock(&self) -> MutexGuard<'_, Outgoing> {
        // A panic elsewhere leaves whole messages in the sink: going on is sound.
        self.outgoing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn send_all(&self) {
        poll_fn(|cx| {
            let mut outgoing = self.lock();
            ready!(self.poll_send(&mut outgoing, cx));
            outgoing.busy = false;
            Poll::Ready(())
        })
        .await;
        self.idle.notify_waiters();
    }

    /// Ready when there is nothing more to send, or the stream has failed.
    fn poll_send(&self, outgoing: &mut Outgoing, cx: &mut Context<'_>) -> Poll<()> {
        loop {
            if let Err(e) = ready!(outgoing.sink.poll_drain(cx)) {
                outgoing.failed = Some(e.kind());
                return Poll::Ready(());
            }
            let counts = &self.shared.counters.sent;
            if let Some(value) = outgoing.newest.take() {
                outgoing.sink.stage(&Message::Latest(value), counts);
            } else if mem::take(&mut outgoing.alive) {
                outgoing.sink.stage(&Message::KeepAlive, counts);
            } else if let Some(reason) = outgoing.closed.take() {
                outgoing.sink.stage(&Message::Close(reason), counts);
            } else {
                return Poll::Ready(());
            }
        }
    }
}

impl Pulse for Cell {
    fn beat(&self) -> bool {
        let mut outgoing = self.lock();
        if outgoing.left || outgoing.failed.is_some() {
            return false;
        }
        if !outgoing.busy && !mem::take(&mut outgoing.spoke) {
            outgoing.alive = outgoing.sink.is_drained();
            // What the stream does not take now goes with what is said next.
            let _later = self.poll_send(&mut outgoing, &mut Context::from_waker(Waker::noop()));
        }
        true
    }
}

impl Outgoing {
    fn check(&self) -> Result<(), LaneSendError> {
        match self.failed {
            Some(kind) => Err(LaneSendError::Lost(Loss::Io(kind.into()))),
            None => Ok(()),
        }
    }
}

#[derive(Debug)]
pub(crate) struct LatestRx {
    source: Source,
    closed: Option<CloseReason>,
    /// What ended the lane behind a value that was given first.
    ended: Option<LaneError>,
}

impl LatestRx {
    pub(crate) fn new(source: Source) -> Self {
        Self { source: source.with_room(ROOM), closed: None, ended: None }
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
            if let Some(value) = self.try_latest(shared)? {
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
