//! The two ends of a byte stream as messages.

use std::fmt;
use std::io;
use std::pin::{Pin, pin};
use std::task::{Context, Poll, ready};

use bytes::{Buf, BytesMut};
use tokio::io::{AsyncReadExt, AsyncWrite};
use trimaran_wire::{Decoder, Format, HEADER_BYTES, Message};

use crate::error::{LaneError, Loss, ProtocolError};
use crate::stats::Direction;
use trimaran_net::{BoxReader, BoxWriter};

/// Reads messages.
pub(crate) struct Source {
    reader: BoxReader,
    decoder: Decoder,
    /// The least number of bytes read at once.
    room: usize,
    /// The stream is at its end, and is not polled again: many panic then.
    end: Option<End>,
}

#[derive(Debug, Clone, Copy)]
enum End {
    Closed,
    Failed(io::ErrorKind),
}

impl fmt::Debug for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Source").field("decoder", &self.decoder).finish_non_exhaustive()
    }
}

impl Source {
    /// Reads `room` bytes or more at once.
    pub(crate) fn new(reader: BoxReader, room: usize, format: Format) -> Self {
        Self { reader, decoder: Decoder::new(format), room, end: None }
    }

    /// Changes the size of reads, for instance once a stranger has become a peer.
    pub(crate) fn with_room(self, room: usize) -> Self {
        Self { room, ..self }
    }

    /// The messages that follow have values of other sizes.
    pub(super) fn with_format(mut self, format: Format) -> Self {
        self.decoder.set_format(format);
        self
    }

    /// How many bytes have arrived without forming a message yet.
    pub(super) fn pending(&self) -> usize {
        self.decoder.pending()
    }

    /// A message that has arrived in full.
    pub(crate) fn next_buffered(&mut self, counts: &Direction) -> Result<Option<Message>, LaneError> {
        let before = self.decoder.position();
        let message =
            self.decoder.next_message().map_err(|e| LaneError::Protocol(ProtocolError::Decode(e)))?;
        if let Some(message) = &message {
            let bytes = self.decoder.position().saturating_sub(before) as usize;
            counts.count(message.kind(), bytes.saturating_sub(HEADER_BYTES));
        }
        Ok(message)
    }

    /// Reads what there is, at least one byte. Returns the end of the stream on every call.
    pub(crate) fn poll_fill(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), LaneError>> {
        let failed = match self.end {
            Some(End::Closed) => None,
            Some(End::Failed(kind)) => Some(kind.into()),
            None => {
                let buffer = self.decoder.buffer(self.room);
                // The future of `read_buf` holds no state of its own, so that a fresh one per poll continues
                // the last one.
                match ready!(pin!(self.reader.read_buf(buffer)).poll(cx)) {
                    Ok(0) => None,
                    Ok(_) => return Poll::Ready(Ok(())),
                    Err(e) => Some(e),
                }
            }
        };
        self.end = Some(failed.as_ref().map_or(End::Closed, |e| End::Failed(e.kind())));
        Poll::Ready(Err(LaneError::Lost(match (failed, self.decoder.pending()) {
            (Some(e), _) => Loss::Io(e),
            (None, 0) => Loss::Closed,
            (None, bytes) => Loss::Cut { bytes },
        })))
    }
}

/// Writes messages.
pub(crate) struct Sink {
    writer: BoxWriter,
    out: BytesMut,
    /// The stream may still hold bytes written to it.
    held: bool,
    /// The stream has failed, or was shut down: it is not polled again.
    end: Option<End>,
}

impl fmt::Debug for Sink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sink").field("waiting", &self.out.len()).finish_non_exhaustive()
    }
}

impl Sink {
    pub(crate) fn new(writer: BoxWriter) -> Self {
        Self { writer, out: BytesMut::new(), held: false, end: None }
    }

    /// Whether everything has been written and passed on.
    pub(crate) fn is_drained(&self) -> bool {
        self.out.is_empty() && !self.held
    }

    /// Adds a message to the bytes to write.
    pub(crate) fn stage(&mut self, message: &Message, counts: &Direction) {
        let before = self.out.len();
        message.encode(&mut self.out);
        counts.count(message.kind(), self.out.len() - before - HEADER_BYTES);
    }

    /// Writes as much as the stream takes now, at least one byte. With nothing to write it flushes the
    /// stream.
    pub(crate) fn poll_write(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.check()?;
        let written = if self.out.is_empty() {
            ready!(Pin::new(&mut self.writer).poll_flush(cx)).map(|()| self.held = false)
        } else {
            ready!(Pin::new(&mut self.writer).poll_write(cx, &self.out)).and_then(|written| match written {
                0 => Err(io::ErrorKind::WriteZero.into()),
                written => {
                    self.out.advance(written);
                    self.held = true;
                    Ok(())
                }
            })
        };
        Poll::Ready(self.noted(written))
    }

    /// Writes everything, and flushes the stream.
    pub(crate) fn poll_drain(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        while !self.is_drained() {
            ready!(self.poll_write(cx))?;
        }
        Poll::Ready(Ok(()))
    }

    /// Tells the peer that nothing more comes.
    pub(crate) fn poll_shutdown(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        if let Some(End::Closed) = self.end {
            return Poll::Ready(Ok(()));
        }
        self.check()?;
        let shut = ready!(Pin::new(&mut self.writer).poll_shutdown(cx));
        let shut = self.noted(shut);
        self.end.get_or_insert(End::Closed);
        Poll::Ready(shut)
    }

    /// Fails if the stream takes no more.
    fn check(&self) -> io::Result<()> {
        match self.end {
            None => Ok(()),
            Some(End::Closed) => Err(io::ErrorKind::BrokenPipe.into()),
            Some(End::Failed(kind)) => Err(kind.into()),
        }
    }

    fn noted(&mut self, done: io::Result<()>) -> io::Result<()> {
        done.inspect_err(|e| self.end = Some(End::Failed(e.kind())))
    }
}
