//! The frames lane over QUIC: a stream for each frame, so that a loss holds up only its own frame on the
//! path.
//!
//! The lane is the sequence of its streams, in the order in which they were opened. Each holds one frame, or
//! the close. Older streams go first where the connection cannot take all.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker, ready};

use bytes::{Bytes, BytesMut};
use quinn::{RecvStream, SendStream, VarInt};
use tokio::io::AsyncReadExt;
use trimaran_wire::{CloseReason, Decoder, Format, FrameMessage, HEADER_BYTES, Kind, Lane, Message};

use super::carrier::{Carrier, all_arrived, loss, read_loss, write_loss};
use crate::error::{LaneError, LaneSendError, Loss, ProtocolError, misplaced};
use crate::lanes::shared::Shared;
use crate::timeouts::Timeouts;
use trimaran_net::Instant;

/// How much is read at once: whole frames, mostly.
const ROOM: usize = 64 * 1024;
/// How much is written to a stream at once.
const PART: usize = 64 * 1024;
/// The code that stops a stream that nobody reads.
const UNREAD: VarInt = VarInt::from_u32(0);

#[derive(Debug)]
pub(crate) struct FrameTx {
    carrier: Arc<Carrier>,
    /// The stream of the open frame.
    stream: Option<SendStream>,
    /// Finished streams that may not have arrived completely.
    flying: VecDeque<SendStream>,
    /// Falls with each stream; starts over after two thousand million.
    priority: i32,
    buffer: BytesMut,
    staged: VecDeque<Part>,
}

/// Bytes of one stream.
#[derive(Debug)]
struct Part {
    bytes: Bytes,
    /// Nothing follows these bytes on their stream.
    last: bool,
}

impl FrameTx {
    pub(crate) fn new(carrier: &Arc<Carrier>) -> Self {
        Self {
            carrier: Arc::clone(carrier),
            stream: None,
            flying: VecDeque::new(),
            priority: 0,
            buffer: BytesMut::new(),
            staged: VecDeque::new(),
        }
    }

    pub(crate) fn stage(&mut self, message: impl Into<Message>, shared: &Shared) {
        let message = message.into();
        // The rest of the buffer serves the following reads; once it is used up, a new one is allocated.
        if self.buffer.capacity() == 0 {
            self.buffer.reserve(PART);
        }
        let before = self.buffer.len();
        message.encode(&mut self.buffer);
        shared.counters.sent.count(message.kind(), self.buffer.len() - before - HEADER_BYTES);
        let last = matches!(message.kind(), Kind::End | Kind::Close);
        if last || self.buffer.len() >= PART {
            self.cut(last);
        }
    }

    fn cut(&mut self, last: bool) {
        self.staged.push_back(Part { bytes: self.buffer.split().freeze(), last });
    }

    /// Passes staged messages to the connection. Any progress restarts the timeout.
    pub(crate) async fn send_staged(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        if !self.buffer.is_empty() {
            self.cut(false);
        }
        while let Some(part) = self.staged.front_mut() {
            let stream = match &mut self.stream {
                Some(stream) => stream,
                None => {
                    let opened = timeouts.wait(None, self.carrier.connection.open_uni()).await;
                    let stream = opened
                        .map_err(|_| LaneSendError::Stalled)?
                        .map_err(|e| LaneSendError::Lost(loss(e)))?;
                    self.priority = self.priority.checked_sub(1).unwrap_or(0);
                    // Fails only for a stream that is closed.
                    let _ = stream.set_priority(self.priority);
                    self.stream.insert(stream)
                }
            };
            while !part.bytes.is_empty() {
                let bytes = std::slice::from_mut(&mut part.bytes);
                timeouts
                    .wait(None, stream.write_chunks(bytes))
                    .await
                    .map_err(|_| LaneSendError::Stalled)?
                    .map_err(|e| LaneSendError::Lost(write_loss(e)))?;
            }
            if part.last {
                self.finish();
            }
            self.staged.pop_front();
        }
        Ok(())
    }

    /// Waits until everything has arrived.
    pub(crate) async fn close(&mut self, timeouts: &mut Timeouts) -> Result<(), LaneSendError> {
        timeouts.wait(None, all_arrived(&self.flying)).await.map_err(|_| LaneSendError::Stalled)
    }

    fn finish(&mut self) {
        if let Some(mut stream) = self.stream.take() {
            // Fails only for a stream that is closed.
            let _ = stream.finish();
            self.flying.push_back(stream);
        }
        // A stream that has arrived completely is forgotten, and has no priority any more.
        while self.flying.front().is_some_and(|stream| stream.priority().is_err()) {
            self.flying.pop_front();
        }
    }
}

impl Drop for FrameTx {
    fn drop(&mut self) {
        self.finish();
        self.carrier.outlive(self.flying.drain(..));
    }
}

#[derive(Debug)]
pub(crate) struct FrameRx {
    carrier: Arc<Carrier>,
    stream: Option<RecvStream>,
    decoder: Decoder,
    /// Between the beginning and the end of a frame.
    within: bool,
    closed: Option<CloseReason>,
}

impl FrameRx {
    pub(crate) fn new(carrier: &Arc<Carrier>, format: Format) -> Self {
        let carrier = Arc::clone(carrier);
        Self { carrier, stream: None, decoder: Decoder::new(format), within: false, closed: None }
    }

    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        timeouts: &mut Timeouts,
    ) -> Result<FrameMessage, LaneError> {
        if let Some(reason) = &self.closed {
            return Err(LaneError::Closed(reason.clone()));
        }
        loop {
            if let Some(message) = self.buffered(shared)? {
                let message = match message {
                    Message::Frame(message) => message,
                    Message::Close(reason) => {
                        self.closed = Some(reason.clone());
                        return Err(LaneError::Closed(reason));
                    }
                    other => return Err(misplaced(other.kind(), Lane::Frames)),
                };
                match &message {
                    FrameMessage::Begin { .. } => self.within = true,
                    FrameMessage::End(_) => self.within = false,
                    _ => {}
                }
                return Ok(message);
            }
            match &mut self.stream {
                Some(stream) => {
                    let decoder = &mut self.decoder;
                    let read = timeouts.wait(by, poll_fn(|cx| poll_fill(stream, decoder, cx))).await;
                    if read.map_err(LaneError::Expired)?? == 0 {
                        self.end_of_stream()?;
                    }
                }
                None => {
                    let accepted = timeouts.wait(by, self.carrier.connection.accept_uni()).await;
                    let stream = accepted.map_err(LaneError::Expired)?;
                    self.stream = Some(stream.map_err(|e| LaneError::Lost(loss(e)))?);
                }
            }
        }
    }

    fn buffered(&mut self, shared: &Shared) -> Result<Option<Message>, LaneError> {
        let before = self.decoder.position();
        let message =
            self.decoder.next_message().map_err(|e| LaneError::Protocol(ProtocolError::Decode(e)))?;
        if let Some(message) = &message {
            let bytes = self.decoder.position().saturating_sub(before) as usize;
            shared.counters.received.count(message.kind(), bytes.saturating_sub(HEADER_BYTES));
        }
        Ok(message)
    }

    /// A stream ends with its frame. One that ends earlier was left by a dropped sender.
    fn end_of_stream(&mut self) -> Result<(), LaneError> {
        match self.decoder.pending() {
            0 if self.within => Err(LaneError::Lost(Loss::Closed)),
            0 => {
                self.stream = None;
                Ok(())
            }
            bytes => Err(LaneError::Lost(Loss::Cut { bytes })),
        }
    }
}

impl Drop for FrameRx {
    /// Tells the peer that its frames are no longer read: later ones are stopped as well.
    fn drop(&mut self) {
        self.stream = None;
        let connection = self.carrier.connection.clone();
        let closed = connection.clone();
        self.carrier.net.spawn(Box::pin(async move {
            let stop = async {
                while let Ok(mut stream) = connection.accept_uni().await {
                    let _ = stream.stop(UNREAD);
                }
            };
            tokio::select! {
                biased;
                () = stop => {}
                _ = closed.closed() => {}
            }
        }));
    }
}

/// Reads what there is; 0 bytes at the end of the stream.
pub(super) fn poll_fill(
    stream: &mut RecvStream,
    decoder: &mut Decoder,
    cx: &mut Context<'_>,
) -> Poll<Result<usize, LaneError>> {
    // The future of `read_buf` holds no state of its own, so that a fresh one per poll continues the last
    // one.
    let read = ready!(pin!(stream.read_buf(decoder.buffer(ROOM))).poll(cx));
    Poll::Ready(read.map_err(|e| LaneError::Lost(e.downcast().map_or_else(Loss::Io, read_loss))))
}

/// Polls without being woken later.
pub(super) fn noop() -> Context<'static> {
    Context::from_waker(Waker::noop())
}
