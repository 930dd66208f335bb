//! Writing to a stream from the sending thread, and from a task where the stream takes no more.

use parking_lot::{Mutex, MutexGuard};
use std::future::poll_fn;
use std::io;
use std::mem;
use std::sync::Arc;
use std::task::{Context, Poll, Waker, ready};

use trimaran_wire::{CloseReason, Message};

use super::pulse::Pulse;
use super::source::Sink;
use crate::error::Loss;
use crate::stats::Counters;
use trimaran_net::Net;

/// Writes each message straight from the sending thread. Only when the stream takes no more does a task take
/// over, and one message waits behind it.
#[derive(Debug)]
pub(super) struct Writer {
    net: Arc<dyn Net>,
    cell: Arc<Cell>,
}

#[derive(Debug)]
pub(super) struct Cell {
    outgoing: Mutex<Outgoing>,
    counters: Arc<Counters>,
}

#[derive(Debug)]
struct Outgoing {
    sink: Sink,
    /// The next message, while older bytes are still being written.
    next: Option<Message>,
    closed: Option<CloseReason>,
    /// A keep-alive is due.
    alive: bool,
    /// Something was sent since the last beat.
    spoke: bool,
    /// Nothing follows the close.
    left: bool,
    /// A task writes. Nobody else may, because a stream wakes only its last poller.
    busy: bool,
    /// The owner waits until the task is done.
    waiting: Option<Waker>,
    failed: Option<io::ErrorKind>,
}

impl Writer {
    pub(super) fn new(net: &Arc<dyn Net>, sink: Sink, counters: &Arc<Counters>) -> Self {
        let outgoing = Outgoing {
            sink,
            next: None,
            closed: None,
            alive: false,
            spoke: false,
            left: false,
            busy: false,
            waiting: None,
            failed: None,
        };
        let cell = Cell { outgoing: Mutex::new(outgoing), counters: Arc::clone(counters) };
        Self { net: Arc::clone(net), cell: Arc::new(cell) }
    }

    pub(super) fn cell(&self) -> &Arc<Cell> {
        &self.cell
    }

    /// Sends `message`. It replaces a waiting one.
    pub(super) fn send(&self, message: Message) -> Result<(), Loss> {
        self.say(|outgoing| outgoing.next = Some(message))
    }

    /// Ready when no message waits.
    pub(super) fn poll_idle(&self, cx: &Context<'_>) -> Poll<Result<(), Loss>> {
        let mut outgoing = self.cell.lock();
        outgoing.check()?;
        if outgoing.busy {
            outgoing.waiting = Some(cx.waker().clone());
            return Poll::Pending;
        }
        Poll::Ready(Ok(()))
    }

    /// Closes the lane behind everything sent.
    pub(super) fn close(&self, reason: CloseReason) -> Result<(), Loss> {
        self.say(|outgoing| {
            outgoing.closed = Some(reason);
            outgoing.left = true;
        })
    }

    fn say(&self, put: impl FnOnce(&mut Outgoing)) -> Result<(), Loss> {
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
        // A panic elsewhere leaves whole messages in the sink, so it can be used on.
        self.outgoing.lock()
    }

    async fn send_all(&self) {
        let waiting = poll_fn(|cx| {
            let mut outgoing = self.lock();
            ready!(self.poll_send(&mut outgoing, cx));
            outgoing.busy = false;
            Poll::Ready(outgoing.waiting.take())
        })
        .await;
        if let Some(waiting) = waiting {
            waiting.wake();
        }
    }

    /// Ready when there is nothing more to send, or the stream has failed.
    fn poll_send(&self, outgoing: &mut Outgoing, cx: &mut Context<'_>) -> Poll<()> {
        loop {
            if let Err(e) = ready!(outgoing.sink.poll_drain(cx)) {
                outgoing.failed = Some(e.kind());
                return Poll::Ready(());
            }
            let counts = &self.counters.sent;
            if let Some(message) = outgoing.next.take() {
                outgoing.sink.stage(&message, counts);
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
            // Bytes that the stream does not take now go with the next message.
            let _later = self.poll_send(&mut outgoing, &mut Context::from_waker(Waker::noop()));
        }
        true
    }
}

impl Outgoing {
    fn check(&self) -> Result<(), Loss> {
        match self.failed {
            Some(kind) => Err(Loss::Io(kind.into())),
            None => Ok(()),
        }
    }
}
