//! The control stream during the handshake, and the link made from it.

use std::future::poll_fn;
use std::sync::Arc;

use bytes::BytesMut;
use futures_util::stream::{self, StreamExt};
use quinn::{Connection, ConnectionError, RecvStream, SendStream, TransportErrorCode, VarInt, WriteError};
use trimaran_wire::{
    ChannelNumber, ChannelSizes, Decoder, Format, HEADER_BYTES, Kind, Message, ProtocolName, Refusal,
    SessionId,
};

use super::carrier::Carrier;
use super::datagrams::{self, mark};
use super::frames::{FrameRx, FrameTx, poll_fill};
use super::latest::{LatestRx, LatestTx};
use super::records::{RecordRx, RecordTx};
use super::tls::Verifier;
use crate::error::{LaneError, Loss};
use crate::handshake::{Handshake, HandshakeError};
use crate::keys::Keys;
use crate::lanes::records::RecordLane;
use crate::lanes::{self, ByteChannel};
use crate::parts::LinkParts;
use crate::peer::Peer;
use crate::peer::PeerAddress;
use crate::stats::Counters;
use crate::transport::Capabilities;
use trimaran_net::Net;

const CAPABILITIES: Capabilities =
    Capabilities { reliable: true, ordered: true, encrypted: true, local: false };

/// The code of a connection that ends because values of the latest lane do not fit.
const NO_DATAGRAMS: VarInt = VarInt::from_u32(1);
/// TLS alerts (RFC 8446, section 6.2).
const CERTIFICATE_UNKNOWN: u8 = 46;
const NO_APPLICATION_PROTOCOL: u8 = 120;

/// A stream in both directions.
pub(crate) type BothWays = (SendStream, RecvStream);

/// The streams beside the control stream.
#[derive(Debug)]
pub(crate) struct Beside {
    pub(crate) messages: BothWays,
    pub(crate) bulk: BothWays,
    /// One for each channel, in their order.
    channels: Vec<BothWays>,
}

/// The stream on which the two sides introduce themselves.
#[derive(Debug)]
pub(crate) struct Control {
    connection: Connection,
    send: SendStream,
    recv: RecvStream,
    format: Format,
    decoder: Decoder,
    counters: Arc<Counters>,
}

impl Control {
    pub(crate) fn new(connection: Connection, (send, recv): BothWays, format: Format) -> Self {
        // Fails only for a stream that is closed.
        let _ = send.set_priority(i32::MAX);
        Self { connection, send, recv, format, decoder: Decoder::new(format), counters: Counters::framed() }
    }

    pub(crate) async fn send(&mut self, message: &Message) -> Result<(), HandshakeError> {
        let mut bytes = BytesMut::new();
        message.encode(&mut bytes);
        self.counters.sent.count(message.kind(), bytes.len() - HEADER_BYTES);
        self.send.write_chunk(bytes.freeze()).await.map_err(|e| match e {
            WriteError::ConnectionLost(e) => HandshakeError::Io(e.into()),
            other => HandshakeError::Io(std::io::Error::other(other)),
        })
    }

    /// Opens the streams beside this one, and announces them to the other side.
    pub(crate) async fn open_beside(&self) -> Result<Beside, HandshakeError> {
        let (messages, bulk) = (self.open().await?, self.open().await?);
        let mut channels = Vec::new();
        for _ in self.format.channels {
            channels.push(self.open().await?);
        }
        Ok(Beside { messages, bulk, channels })
    }

    /// Waits for the streams of the connecting side. They come in the order in which they were opened.
    pub(super) async fn accept_beside(&self) -> Result<Beside, HandshakeError> {
        let (messages, bulk) = (self.accept().await?, self.accept().await?);
        let mut channels = Vec::new();
        for _ in self.format.channels {
            channels.push(self.accept().await?);
        }
        Ok(Beside { messages, bulk, channels })
    }

    async fn open(&self) -> Result<BothWays, HandshakeError> {
        let (mut send, recv) = self.connection.open_bi().await.map_err(|e| HandshakeError::Io(e.into()))?;
        let mut bytes = BytesMut::new();
        Message::KeepAlive.encode(&mut bytes);
        send.write_chunk(bytes.freeze()).await.map_err(|e| HandshakeError::Io(std::io::Error::other(e)))?;
        self.counters.sent.count(Kind::KeepAlive, 0);
        Ok((send, recv))
    }

    async fn accept(&self) -> Result<BothWays, HandshakeError> {
        self.connection.accept_bi().await.map_err(|e| HandshakeError::Io(e.into()))
    }

    pub(super) fn into_parts(
        self,
        net: &Arc<dyn Net>,
        peer: Peer,
        (session, Beside { messages, bulk, channels }): (SessionId, Beside),
    ) -> LinkParts {
        let Self { connection, send, recv, format, decoder, counters } = self;
        let address = PeerAddress::Quic(connection.remote_address());
        let carrier = Carrier::new(net, connection);
        let counts = &counters;
        let records = |lane, (send, recv): BothWays| {
            let tx = RecordTx::new(&carrier, lane, send, counts);
            (Box::new(tx) as _, Box::new(RecordRx::new(&carrier, lane, recv, format, counts)) as _)
        };
        let mut datagrams = datagrams::share(net, &carrier.connection, &format).into_iter();
        let mut datagrams = move || datagrams.next().unwrap_or_else(|| stream::pending().boxed());
        let latest = (
            LatestTx::new(&carrier, send, mark(&format, None), counts),
            LatestRx::new(&carrier, recv, decoder, (format, datagrams()), counts),
        );
        let channels = (0..)
            .zip(format.channels)
            .zip(channels)
            .map(|((number, channel), (send, recv))| {
                let (own, datagrams) = (Format::of_channel(channel), datagrams());
                match channel.sizes() {
                    ChannelSizes::Latest { .. } => {
                        // Fails only for a stream that is closed.
                        let _ = send.set_priority(i32::MAX);
                        let mark = mark(&format, Some(ChannelNumber(number)));
                        let tx = LatestTx::new(&carrier, send, mark, counts);
                        let rx = LatestRx::new(&carrier, recv, Decoder::new(own), (own, datagrams), counts);
                        ByteChannel::Latest((Box::new(tx), Box::new(rx)))
                    }
                    ChannelSizes::Frames { .. } => {
                        let tx = FrameTx::channel(&carrier, send, counts);
                        let rx = FrameRx::channel(&carrier, recv, own, counts);
                        ByteChannel::Frames((Box::new(tx), Box::new(rx)))
                    }
                }
            })
            .collect();
        let lanes = lanes::Lanes {
            latest: (Box::new(latest.0), Box::new(latest.1)),
            frames: (
                Box::new(FrameTx::new(&carrier, !format.channels.is_empty(), counts)),
                Box::new(FrameRx::new(&carrier, format, counts)),
            ),
            messages: records(RecordLane::Messages, messages),
            bulk: records(RecordLane::Bulk, bulk),
        };
        LinkParts::new(lanes, peer, session, address, CAPABILITIES, counters).with_channels(channels)
    }
}

impl Handshake for Control {
    async fn recv(&mut self) -> Result<Message, HandshakeError> {
        loop {
            let before = self.decoder.position();
            if let Some(message) = self.decoder.next_message()? {
                let bytes = (self.decoder.position() - before) as usize;
                self.counters.received.count(message.kind(), bytes.saturating_sub(HEADER_BYTES));
                return Ok(message);
            }
            if poll_fn(|cx| poll_fill(&mut self.recv, &mut self.decoder, cx)).await? == 0 {
                return Err(LaneError::Lost(Loss::Closed).into());
            }
        }
    }

    /// Waits until the refusal has arrived.
    async fn dismiss(&mut self, refusal: Refusal) -> Result<(), HandshakeError> {
        self.send(&Message::Refuse(refusal)).await?;
        // Fails only for a stream that is closed.
        let _ = self.send.finish();
        let _gone = self.send.stopped().await;
        Ok(())
    }
}

/// Checks that values of the latest lane fit into datagrams; if not, tells the peer why.
pub(super) fn check_datagrams(connection: &Connection, format: &Format) -> Result<(), HandshakeError> {
    let (needed, allowed) =
        (datagrams::sizes(format).max().unwrap_or_default(), connection.max_datagram_size());
    if allowed.is_some_and(|bytes| bytes >= needed) {
        return Ok(());
    }
    let error = HandshakeError::Datagrams { needed, allowed };
    connection.close(NO_DATAGRAMS, error.to_string().as_bytes());
    Err(error)
}

/// The meaning of a failed connection; `ours` are this side's keys, `protocol` is its protocol.
pub(super) fn explain(
    error: ConnectionError,
    verifier: &Verifier,
    ours: &Keys,
    protocol: ProtocolName,
) -> HandshakeError {
    if let Some(unknown) = verifier.turned_away() {
        return Box::new(unknown).into();
    }
    let alert = |code| match code {
        code if code == TransportErrorCode::crypto(CERTIFICATE_UNKNOWN) => {
            ours.public().quic.map(|presented| HandshakeError::NotKnown { presented })
        }
        code if code == TransportErrorCode::crypto(NO_APPLICATION_PROTOCOL) => {
            Some(HandshakeError::Alpn(protocol.clone()))
        }
        code if code == TransportErrorCode::CONNECTION_REFUSED => {
            Some(HandshakeError::Refused(Refusal::Busy))
        }
        // Its handshake gave way to another, or its listener has closed.
        code if code == TransportErrorCode::APPLICATION_ERROR => Some(HandshakeError::Closed),
        _ => None,
    };
    let known = match &error {
        ConnectionError::ConnectionClosed(close) => alert(close.error_code),
        ConnectionError::TransportError(error) => alert(error.code),
        ConnectionError::TimedOut => Some(HandshakeError::TimedOut),
        _ => None,
    };
    known.unwrap_or_else(|| HandshakeError::Io(error.into()))
}
