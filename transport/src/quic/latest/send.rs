//! Sending values, and the task that copies the newest one.

use parking_lot::Mutex;
use std::future::poll_fn;
use std::io;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use bytes::BytesMut;
use quinn::{SendDatagramError, SendStream, StoppedError, WriteError};
use tokio::sync::Notify;
use trimaran_wire::{CloseReason, FixedBytes, Kind, Message, Numbered, Serial};

use crate::error::Loss;
use crate::lanes::half::{Half, LaneTx, Tx};
use crate::quic::carrier::{Carrier, loss, write_loss};
use crate::stats::Counters;
use trimaran_net::Timer;

/// The shortest quiet time after which the newest value is copied; on longer paths 1.5 round trips.
const QUIET: Duration = Duration::from_millis(5);
/// How many values a new buffer has room for.
const VALUES: usize = 64;

#[derive(Debug)]
pub(crate) struct LatestTx {
    cell: Arc<Cell>,
    carrier: Arc<Carrier>,
    counters: Arc<Counters>,
    next: Serial,
    /// The first byte of its datagrams, where there are channels.
    mark: Option<u8>,
    buffer: BytesMut,
}

#[derive(Debug, Default)]
struct Cell {
    state: Mutex<State>,
    /// Notified when there is something to copy or to end.
    changed: Notify,
}

#[derive(Debug, Default)]
struct State {
    /// The newest value, until it is copied.
    newest: Option<Numbered>,
    closed: Option<CloseReason>,
    leaving: bool,
    /// The close has arrived, or never will.
    ended: bool,
    /// The owner waits for that.
    waiting: Option<Waker>,
    failed: Option<io::ErrorKind>,
}

impl LatestTx {
    pub(crate) fn new(
        carrier: &Arc<Carrier>,
        control: SendStream,
        mark: Option<u8>,
        counters: &Arc<Counters>,
    ) -> Self {
        let (cell, counters) = (Arc::<Cell>::default(), Arc::clone(counters));
        let copier = Copier {
            cell: Arc::clone(&cell),
            carrier: Arc::clone(carrier),
            control,
            counters: Arc::clone(&counters),
        };
        carrier.net.spawn(Box::pin(copier.run()));
        let carrier = Arc::clone(carrier);
        Self { cell, carrier, counters, next: Serial::default(), mark, buffer: BytesMut::new() }
    }
}

impl Half for LatestTx {}

impl LaneTx for LatestTx {
    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        let mut state = self.cell.state.lock();
        state.closed = Some(reason);
        state.leaving = true;
        drop(state);
        self.cell.changed.notify_one();
        Ok(())
    }

    fn poll_closed(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        let mut state = self.cell.state.lock();
        if let Some(kind) = state.failed {
            return Poll::Ready(Err(Loss::Io(kind.into())));
        }
        if state.ended {
            return Poll::Ready(Ok(()));
        }
        state.waiting = Some(cx.waker().clone());
        Poll::Pending
    }
}

impl Tx<FixedBytes> for LatestTx {
    fn stage(&mut self, value: FixedBytes) -> Result<(), Loss> {
        let bytes = value.len();
        let numbered = Numbered { number: self.next, value };
        let size = Numbered::NUMBER_BYTES + bytes + usize::from(self.mark.is_some());
        if self.buffer.capacity() < size {
            self.buffer.reserve(VALUES * size);
        }
        self.buffer.extend(self.mark);
        numbered.write(&mut self.buffer);
        self.carrier.connection.send_datagram(self.buffer.split().freeze()).map_err(|e| match e {
            SendDatagramError::ConnectionLost(e) => loss(e),
            other => Loss::Io(io::Error::other(other)),
        })?;
        self.counters.sent.count(Kind::Latest, bytes);
        self.next = self.next.next();
        // The copier checks for newer values while it has one to copy.
        if self.cell.state.lock().newest.replace(numbered).is_none() {
            self.cell.changed.notify_one();
        }
        Ok(())
    }
}

impl Drop for LatestTx {
    fn drop(&mut self) {
        self.cell.state.lock().leaving = true;
        self.cell.changed.notify_one();
    }
}

/// Writes the control stream.
struct Copier {
    cell: Arc<Cell>,
    /// Kept until the last value has arrived, even if all halves are gone.
    carrier: Arc<Carrier>,
    control: SendStream,
    counters: Arc<Counters>,
}

impl Copier {
    async fn run(mut self) {
        let connection = self.carrier.connection.clone();
        // A peer that has left may have received everything.
        let failed = tokio::select! {
            biased;
            sent = self.copy() => sent.err().map(|e| match write_loss(e) {
                Loss::Io(e) => e.kind(),
                _ => io::ErrorKind::ConnectionAborted,
            }),
            e = connection.closed() => Some(io::Error::from(e).kind()),
        };
        let waiting = {
            let mut state = self.cell.state.lock();
            state.ended = true;
            state.failed = failed;
            state.waiting.take()
        };
        if let Some(waiting) = waiting {
            waiting.wake();
        }
        self.carrier.outlive([self.control]);
    }

    async fn copy(&mut self) -> Result<(), WriteError> {
        let mut timer = self.carrier.net.timer();
        loop {
            self.cell.changed.notified().await;
            while let Some(newest) = self.quiet(&mut *timer).await {
                self.write(&Message::Numbered(newest)).await?;
            }
            let closed = {
                let mut state = self.cell.state.lock();
                if !state.leaving {
                    continue;
                }
                state.closed.take()
            };
            if let Some(reason) = closed {
                let bytes = self.write(&Message::Close(reason)).await?;
                self.counters.sent.count(Kind::Close, bytes);
            }
            // Fails only for a stream that is closed.
            let _ = self.control.finish();
            return match self.control.stopped().await {
                Ok(_) => Ok(()),
                Err(StoppedError::ConnectionLost(e)) => Err(WriteError::ConnectionLost(e)),
                Err(StoppedError::ZeroRttRejected) => Err(WriteError::ZeroRttRejected),
            };
        }
    }

    /// The newest value after a quiet time; `None` if there is nothing to copy.
    async fn quiet(&self, timer: &mut dyn Timer) -> Option<Numbered> {
        loop {
            let seen = {
                let mut state = self.cell.state.lock();
                if state.leaving {
                    return state.newest.take();
                }
                state.newest.as_ref()?.number
            };
            let pause = (self.carrier.connection.rtt() * 3 / 2).max(QUIET);
            timer.reset(self.carrier.net.now().after(pause));
            loop {
                tokio::select! {
                    biased;
                    () = poll_fn(|cx| timer.poll(cx)) => break,
                    () = self.cell.changed.notified() => if self.cell.state.lock().leaving { break },
                }
            }
            let mut state = self.cell.state.lock();
            if state.leaving || state.newest.as_ref().is_some_and(|newest| newest.number == seen) {
                return state.newest.take();
            }
        }
    }

    /// Writes a message; returns the length of its payload.
    async fn write(&mut self, message: &Message) -> Result<usize, WriteError> {
        let mut bytes = BytesMut::new();
        message.encode(&mut bytes);
        let payload = bytes.len() - trimaran_wire::HEADER_BYTES;
        self.control.write_chunk(bytes.freeze()).await?;
        Ok(payload)
    }
}
