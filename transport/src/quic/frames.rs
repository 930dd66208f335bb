//! The frames lane over QUIC: a stream for each frame, so that a loss holds up only its own frame on the
//! path.
//!
//! The lane is the sequence of its streams, in the order in which they were opened. Each holds one frame, or
//! the close. Older streams go first where the connection cannot take all. With channels all frames have the
//! same precedence, and each channel of frames has one stream of its own for all of them.

use std::collections::VecDeque;
use std::fmt;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use bytes::{Bytes, BytesMut};
use futures_util::future::{BoxFuture, FutureExt, join_all, ready as at_once};
use futures_util::stream::{self, BoxStream, StreamExt};
use quinn::{Connection, ConnectionError, RecvStream, SendStream, VarInt};
use tokio::io::AsyncReadExt;
use trimaran_wire::{CloseReason, Decoder, Format, FrameMessage, HEADER_BYTES, Kind, Lane, Message};

use super::carrier::{Carrier, loss, read_loss, write_loss};
use crate::error::{LaneError, Loss, ProtocolError, misplaced};
use crate::lanes::half::{Half, LaneTx, Rx, Tx};
use crate::stats::{Counters, Direction};

/// How much is read at once: whole frames, mostly.
const ROOM: usize = 64 * 1024;
/// How much is written to a stream at once.
const PART: usize = 64 * 1024;
/// The code that stops a stream that nobody reads.
const UNREAD: VarInt = VarInt::from_u32(0);

/// Streams, one after the other, as quinn gives them.
type Streams<S> = BoxStream<'static, Result<S, ConnectionError>>;

pub(crate) struct FrameTx {
    carrier: Arc<Carrier>,
    counters: Arc<Counters>,
    /// Opens streams.
    open: Streams<SendStream>,
    /// The stream of the open frame.
    stream: Option<SendStream>,
    /// Finished streams that may not have arrived completely.
    flying: VecDeque<SendStream>,
    /// Falls with each stream; starts over after two thousand million. With channels it stays.
    priority: i32,
    falls: bool,
    /// One stream holds all frames.
    single: bool,
    buffer: BytesMut,
    staged: VecDeque<Part>,
    /// Ends when everything has arrived.
    arrived: Option<BoxFuture<'static, ()>>,
}

impl fmt::Debug for FrameTx {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FrameTx").field("staged", &self.staged).finish_non_exhaustive()
    }
}

/// Bytes of one stream.
#[derive(Debug)]
struct Part {
    bytes: Bytes,
    /// Nothing follows these bytes on their stream.
    last: bool,
}

impl FrameTx {
    /// The frames lane of a link, with a stream for each frame. Older ones go first unless there are
    /// channels.
    pub(crate) fn new(carrier: &Arc<Carrier>, has_channels: bool, counters: &Arc<Counters>) -> Self {
        let open = |connection: Connection| async { Some((connection.open_uni().await, connection)) };
        let open = stream::unfold(carrier.connection.clone(), open).boxed();
        let mut all = Self::over(carrier, open, counters);
        all.falls = !has_channels;
        all
    }

    /// A channel, all of whose frames are on one stream.
    pub(crate) fn channel(carrier: &Arc<Carrier>, stream: SendStream, counters: &Arc<Counters>) -> Self {
        let open = stream::once(at_once(Ok(stream))).boxed();
        let mut channel = Self::over(carrier, open, counters);
        channel.single = true;
        channel
    }

    /// Without precedence, and a stream for each frame.
    fn over(carrier: &Arc<Carrier>, open: Streams<SendStream>, counters: &Arc<Counters>) -> Self {
        Self {
            carrier: Arc::clone(carrier),
            counters: Arc::clone(counters),
            open,
            stream: None,
            flying: VecDeque::new(),
            priority: 0,
            falls: false,
            single: false,
            buffer: BytesMut::new(),
            staged: VecDeque::new(),
            arrived: None,
        }
    }

    fn put(&mut self, message: &Message) {
        // The rest of the buffer serves the following reads; once it is used up, a new one is allocated.
        if self.buffer.capacity() == 0 {
            self.buffer.reserve(PART);
        }
        let before = self.buffer.len();
        message.encode(&mut self.buffer);
        self.counters.sent.count(message.kind(), self.buffer.len() - before - HEADER_BYTES);
        let last = match message.kind() {
            Kind::Close => true,
            Kind::End => !self.single,
            _ => false,
        };
        if last || self.buffer.len() >= PART {
            self.cut(last);
        }
    }

    fn cut(&mut self, last: bool) {
        self.staged.push_back(Part { bytes: self.buffer.split().freeze(), last });
    }

    /// The stream of the open frame.
    fn poll_stream(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        if self.stream.is_none()
            && let Some(opened) = ready!(self.open.poll_next_unpin(cx))
        {
            let stream = opened.map_err(loss)?;
            if self.falls {
                self.priority = self.priority.checked_sub(1).unwrap_or(0);
            }
            // Fails only for a stream that is closed.
            let _ = stream.set_priority(self.priority);
            self.stream = Some(stream);
        }
        Poll::Ready(Ok(()))
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

impl Half for FrameTx {}

impl LaneTx for FrameTx {
    fn poll_send(&mut self, cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        if !self.buffer.is_empty() {
            self.cut(false);
        }
        if self.staged.is_empty() {
            return Poll::Ready(Ok(true));
        }
        ready!(self.poll_stream(cx))?;
        if let (Some(part), Some(stream)) = (self.staged.front_mut(), &mut self.stream) {
            if !part.bytes.is_empty() {
                // The future holds no state of its own, so that a fresh one per poll continues the last one.
                let bytes = std::slice::from_mut(&mut part.bytes);
                ready!(pin!(stream.write_chunks(bytes)).poll(cx)).map_err(write_loss)?;
            }
            if part.bytes.is_empty() {
                let last = part.last;
                self.staged.pop_front();
                if last {
                    self.finish();
                }
            }
        }
        Poll::Ready(Ok(self.staged.is_empty()))
    }

    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.put(&Message::Close(reason));
        Ok(())
    }

    fn poll_closed(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        let arrive = || join_all(self.flying.iter().map(SendStream::stopped)).map(drop).boxed();
        self.arrived.get_or_insert_with(arrive).poll_unpin(cx).map(Ok)
    }
}

impl Tx<FrameMessage> for FrameTx {
    fn stage(&mut self, message: FrameMessage) -> Result<(), Loss> {
        self.put(&message.into());
        Ok(())
    }
}

impl Drop for FrameTx {
    fn drop(&mut self) {
        self.finish();
        self.carrier.outlive(self.flying.drain(..));
    }
}

pub(crate) struct FrameRx {
    carrier: Arc<Carrier>,
    counters: Arc<Counters>,
    /// The peer's streams.
    accept: Streams<RecvStream>,
    stream: Option<RecvStream>,
    decoder: Decoder,
    /// Between the beginning and the end of a frame.
    within: bool,
    /// One stream holds all frames.
    single: bool,
    closed: Option<CloseReason>,
}

impl fmt::Debug for FrameRx {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FrameRx").field("decoder", &self.decoder).finish_non_exhaustive()
    }
}

impl FrameRx {
    pub(crate) fn new(carrier: &Arc<Carrier>, format: Format, counters: &Arc<Counters>) -> Self {
        let accept = |connection: Connection| async { Some((connection.accept_uni().await, connection)) };
        let accept = stream::unfold(carrier.connection.clone(), accept).boxed();
        Self::over(carrier, (accept, false), format, counters)
    }

    /// A channel, all of whose frames are on one stream.
    pub(crate) fn channel(
        carrier: &Arc<Carrier>,
        stream: RecvStream,
        format: Format,
        counters: &Arc<Counters>,
    ) -> Self {
        let over = stream::repeat_with(|| Err(ConnectionError::LocallyClosed));
        let accept = stream::once(at_once(Ok(stream))).chain(over).boxed();
        Self::over(carrier, (accept, true), format, counters)
    }

    fn over(
        carrier: &Arc<Carrier>,
        (accept, single): (Streams<RecvStream>, bool),
        format: Format,
        counters: &Arc<Counters>,
    ) -> Self {
        Self {
            carrier: Arc::clone(carrier),
            counters: Arc::clone(counters),
            accept,
            stream: None,
            decoder: Decoder::new(format),
            within: false,
            single,
            closed: None,
        }
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

impl Half for FrameRx {}

impl Rx<FrameMessage> for FrameRx {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<FrameMessage>, LaneError>> {
        if let Some(reason) = &self.closed {
            return Poll::Ready(Err(LaneError::Closed(reason.clone())));
        }
        match buffered(&mut self.decoder, &self.counters.received)? {
            Some(Message::Frame(message)) => {
                match &message {
                    FrameMessage::Begin { .. } => self.within = true,
                    FrameMessage::End(_) => self.within = false,
                    _ => {}
                }
                return Poll::Ready(Ok(Some(message)));
            }
            Some(Message::Close(reason)) => {
                self.closed = Some(reason.clone());
                return Poll::Ready(Err(LaneError::Closed(reason)));
            }
            // The stream of a channel begins with one.
            Some(Message::KeepAlive) if self.single => return Poll::Ready(Ok(None)),
            Some(other) => return Poll::Ready(Err(misplaced(other.kind(), Lane::Frames))),
            None => {}
        }
        match &mut self.stream {
            Some(stream) => {
                if ready!(poll_fill(stream, &mut self.decoder, cx))? == 0 {
                    self.end_of_stream()?;
                }
            }
            None => {
                let accepted = ready!(self.accept.poll_next_unpin(cx)).transpose();
                self.stream = accepted.map_err(|e| LaneError::Lost(loss(e)))?;
            }
        }
        Poll::Ready(Ok(None))
    }
}

impl Drop for FrameRx {
    /// Tells the peer that its frames are no longer read: later ones are stopped as well.
    fn drop(&mut self) {
        self.stream = None;
        if self.single {
            return;
        }
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

/// A message that has arrived in full.
pub(super) fn buffered(decoder: &mut Decoder, counts: &Direction) -> Result<Option<Message>, LaneError> {
    let before = decoder.position();
    let message = decoder.next_message().map_err(|e| LaneError::Protocol(ProtocolError::Decode(e)))?;
    if let Some(message) = &message {
        let bytes = decoder.position().saturating_sub(before) as usize;
        counts.count(message.kind(), bytes.saturating_sub(HEADER_BYTES));
    }
    Ok(message)
}
