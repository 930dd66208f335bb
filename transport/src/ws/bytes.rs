//! A WebSocket as a stream of bytes. They travel as binary messages of any size up to a limit; the boundaries
//! of messages have no meaning.

use std::io;
use std::iter;
use std::pin::Pin;
use std::task::{Context, Poll};

use ::bytes::Bytes;
use futures_util::{Sink, SinkExt, StreamExt, TryStreamExt, future, stream};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::error::ProtocolError;
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_util::io::{CopyToBytes, SinkWriter, StreamReader};
use trimaran_net::{Stream, StreamPeer};

/// The most bytes of one message, either way.
const MESSAGE: usize = 64 * 1024;
/// The most pings and pongs in a row. A browser sends none by itself.
const CONTROLS: u32 = 100;
/// The size of a read.
const READ: usize = 16 * 1024;

/// The limits of received messages: a peer cannot make this side hold more than one.
pub(super) fn config() -> WebSocketConfig {
    WebSocketConfig::default()
        .read_buffer_size(READ)
        .write_buffer_size(MESSAGE)
        .max_message_size(Some(MESSAGE))
        .max_frame_size(Some(MESSAGE))
}

/// The bytes of a WebSocket.
pub(super) fn of<S>(socket: WebSocketStream<S>, peer: StreamPeer) -> Stream
where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let (sink, stream) = socket.split();
    // A peer that crashed may have closed neither the WebSocket nor TLS: the byte stream ends either way.
    let messages = stream.scan((), |(), message| {
        future::ready(match message {
            Err(Error::Protocol(ProtocolError::ResetWithoutClosingHandshake)) => None,
            Err(Error::Io(e)) if e.kind() == io::ErrorKind::UnexpectedEof => None,
            message => Some(message.map_err(io_error)),
        })
    });
    // tungstenite handles pings and pongs. Messages without data cost as much as others.
    let mut controls = 0;
    let bytes = messages.try_filter_map(move |message| {
        future::ready(match message {
            Message::Binary(bytes) if bytes.is_empty() => Err(invalid("a message without bytes came")),
            Message::Binary(bytes) => {
                controls = 0;
                Ok(Some(bytes))
            }
            Message::Text(_) => Err(invalid("a message of text came")),
            _ if controls == CONTROLS => Err(invalid("pings come and nothing else")),
            _ => {
                controls += 1;
                Ok(None)
            }
        })
    });
    let sink = IoSink(sink).with_flat_map(|mut bytes: Bytes| {
        let pieces = iter::from_fn(move || {
            let piece = bytes.split_to(bytes.len().min(MESSAGE));
            (!piece.is_empty()).then(|| Ok(Message::Binary(piece)))
        });
        stream::iter(pieces)
    });
    Stream {
        reader: Box::new(StreamReader::new(bytes)),
        writer: Box::new(SinkWriter::new(CopyToBytes::new(sink))),
        peer,
    }
}

fn invalid(why: &'static str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, why)
}

/// The sending half of a WebSocket, with stream errors. Unlike `sink_map_err` it may be used after one.
struct IoSink<S>(S);

impl<S: Sink<Message, Error = Error> + Unpin> Sink<Message> for IoSink<S> {
    type Error = io::Error;

    fn poll_ready(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.0.poll_ready_unpin(cx).map_err(io_error)
    }

    fn start_send(mut self: Pin<&mut Self>, message: Message) -> io::Result<()> {
        self.0.start_send_unpin(message).map_err(io_error)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.0.poll_flush_unpin(cx).map_err(io_error)
    }

    fn poll_close(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.0.poll_close_unpin(cx).map_err(io_error)
    }
}

pub(super) fn io_error(error: Error) -> io::Error {
    match error {
        Error::Io(error) => error,
        Error::ConnectionClosed | Error::AlreadyClosed => io::ErrorKind::BrokenPipe.into(),
        other => io::Error::other(other),
    }
}
