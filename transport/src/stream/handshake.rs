//! One connection of a link over byte streams, during and after the handshake.

use std::future::poll_fn;
use std::sync::Arc;
use std::time::Duration;

use trimaran_wire::{Format, Hello, Message, Refusal, SessionId};

use super::frames::{Outlet, frames as frames_lane};
use super::latest::{LatestRx, LatestTx};
use super::pulse::{Pulse, keep_alive};
use super::records::records;
use super::source::{Sink, Source};
use super::writer::Cell;
use crate::handshake::{Handshake, HandshakeError};
use crate::lanes::Lanes as AllLanes;
use crate::lanes::records::RecordLane;
use crate::parts::LinkParts;
use crate::peer::Peer;
use crate::peer::PeerAddress;
use crate::stats::Counters;
use crate::transport::Capabilities;
use crate::transport::Transport;
use trimaran_net::{Net, Stream};

/// How much is read at once before the peer is known.
const ROOM: usize = 512;

/// A connection during the handshake.
#[derive(Debug)]
pub(crate) struct Connection {
    source: Source,
    sink: Sink,
    pub(super) address: PeerAddress,
    counters: Arc<Counters>,
}

impl Connection {
    pub(crate) fn new(
        stream: Stream,
        transport: &dyn Transport,
        format: Format,
        counters: &Arc<Counters>,
    ) -> Self {
        Self {
            source: Source::new(stream.reader, ROOM, format),
            sink: Sink::new(stream.writer),
            address: PeerAddress::over(transport.scheme(), stream.peer),
            counters: Arc::clone(counters),
        }
    }

    pub(super) async fn send(&mut self, message: &Message) -> Result<(), HandshakeError> {
        self.sink.stage(message, &self.counters.sent);
        poll_fn(|cx| self.sink.poll_drain(cx)).await.map_err(HandshakeError::Io)
    }

    /// Sends the hello. If the listener refuses, the write may fail, but its reason can still be read.
    pub(super) async fn greet(&mut self, hello: Hello) -> Result<(), HandshakeError> {
        let Err(unsaid) = self.send(&Message::Hello(hello)).await else { return Ok(()) };
        match self.recv_answer().await {
            Err(refused @ HandshakeError::Refused(_)) => Err(refused),
            _ => Err(unsaid),
        }
    }
}

impl Handshake for Connection {
    async fn recv(&mut self) -> Result<Message, HandshakeError> {
        loop {
            if let Some(message) = self.source.next_buffered(&self.counters.received)? {
                return Ok(message);
            }
            poll_fn(|cx| self.source.poll_fill(cx)).await?;
        }
    }

    async fn dismiss(&mut self, refusal: Refusal) -> Result<(), HandshakeError> {
        self.send(&Message::Refuse(refusal)).await?;
        poll_fn(|cx| self.sink.poll_shutdown(cx)).await.map_err(HandshakeError::Io)
    }
}

/// The connections of a link whose handshake is done.
#[derive(Debug)]
pub(crate) struct Lanes {
    pub(crate) latest: Connection,
    pub(crate) frames: Connection,
    pub(crate) messages: Connection,
    pub(crate) bulk: Connection,
    pub(crate) capabilities: Capabilities,
}

impl Lanes {
    pub(crate) fn into_parts(
        self,
        net: &Arc<dyn Net>,
        idle_timeout: Duration,
        peer: Peer,
        session: SessionId,
    ) -> LinkParts {
        let Self { latest, frames, messages, bulk, capabilities } = self;
        let (counters, address) = (frames.counters, frames.address);
        for other in [&latest.counters, &messages.counters, &bulk.counters] {
            if !Arc::ptr_eq(&counters, other) {
                counters.absorb(other);
            }
        }
        let latest_tx = LatestTx::new(net, latest.sink, &counters);
        let (frames_tx, frames_rx) = frames_lane(frames.sink, frames.source, &counters);
        let records = |lane, of: Connection| records(lane, net, of.sink, of.source, &counters);
        let messages = records(RecordLane::Messages, messages);
        let bulk = records(RecordLane::Bulk, bulk);
        let latest_pulse: Arc<dyn Pulse> = Arc::<Cell>::clone(latest_tx.cell());
        let frames_pulse: Arc<dyn Pulse> = Arc::<Outlet>::clone(frames_tx.outlet());
        let [messages_pulse, bulk_pulse] =
            [&messages.0, &bulk.0].map(|tx| Arc::<Cell>::clone(tx.cell()) as Arc<dyn Pulse>);
        let lanes = [&latest_pulse, &frames_pulse, &messages_pulse, &bulk_pulse].map(Arc::downgrade);
        keep_alive(net, idle_timeout / 4, lanes);
        let latest_rx = LatestRx::new(latest.source, &counters);
        let lanes = AllLanes {
            latest: (Box::new(latest_tx), Box::new(latest_rx)),
            frames: (Box::new(frames_tx), Box::new(frames_rx)),
            messages: (Box::new(messages.0), Box::new(messages.1)),
            bulk: (Box::new(bulk.0), Box::new(bulk.1)),
        };
        let parts = LinkParts::new(lanes, peer, session, address, capabilities, counters);
        parts.with_idle_timeout(idle_timeout)
    }
}
