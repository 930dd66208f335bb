//! One connection of a link over byte streams, during and after the handshake.

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::sync::{Arc, Weak};
use std::time::Duration;

use trimaran_wire::{Channel, ChannelNumber, ChannelSizes, Format, Hello, Lane, Message, Refusal, SessionId};

use super::frames::{Outlet, frames as frames_lane};
use super::latest::{LatestRx, LatestTx};
use super::pulse::{Pulse, keep_alive};
use super::records::records;
use super::source::{Sink, Source};
use super::writer::Cell;
use crate::handshake::{Handshake, HandshakeError};
use crate::lanes::records::RecordLane;
use crate::lanes::{ByteChannel, Lanes as AllLanes};
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

impl Connection {
    /// The halves of a channel, and the object that sends its keep-alives.
    fn into_channel(
        self,
        net: &Arc<dyn Net>,
        declared: &Channel,
        counters: &Arc<Counters>,
    ) -> (ByteChannel, Weak<dyn Pulse>) {
        let source = self.source.with_format(Format::of_channel(declared));
        match declared.sizes() {
            ChannelSizes::Latest { .. } => {
                let tx = LatestTx::new(net, self.sink, counters);
                let pulse: Arc<dyn Pulse> = Arc::<Cell>::clone(tx.cell());
                let rx = LatestRx::new(source, counters);
                (ByteChannel::Latest((Box::new(tx), Box::new(rx))), Arc::downgrade(&pulse))
            }
            ChannelSizes::Frames { .. } => {
                let (tx, rx) = frames_lane(self.sink, source, counters);
                let pulse: Arc<dyn Pulse> = Arc::<Outlet>::clone(tx.outlet());
                (ByteChannel::Frames((Box::new(tx), Box::new(rx))), Arc::downgrade(&pulse))
            }
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
    /// Those of the channels, with their declarations.
    pub(crate) channels: Vec<(Channel, Connection)>,
    pub(crate) capabilities: Capabilities,
}

impl Lanes {
    /// The lanes of a link with `channels`, if all of their connections are there.
    pub(super) fn of(
        mut connections: BTreeMap<Lane, Connection>,
        channels: &[Channel],
        transport: &dyn Transport,
    ) -> Option<Self> {
        let mut take = |lane| connections.remove(&lane);
        Some(Self {
            latest: take(Lane::Latest)?,
            frames: take(Lane::Frames)?,
            messages: take(Lane::Messages)?,
            bulk: take(Lane::Bulk)?,
            channels: (0..)
                .zip(channels)
                .map(|(number, channel)| Some((*channel, take(Lane::Channel(ChannelNumber(number)))?)))
                .collect::<Option<_>>()?,
            capabilities: Capabilities::over(transport),
        })
    }

    /// Sends the answer on each connection.
    pub(super) async fn accept(&mut self, accept: &Message) -> Result<(), HandshakeError> {
        let Self { latest, frames, messages, bulk, channels, .. } = self;
        let channels = channels.iter_mut().map(|(_, connection)| connection);
        for connection in [latest, frames, messages, bulk].into_iter().chain(channels) {
            connection.send(accept).await?;
        }
        Ok(())
    }

    pub(crate) fn into_parts(
        self,
        net: &Arc<dyn Net>,
        idle_timeout: Duration,
        peer: Peer,
        session: SessionId,
    ) -> LinkParts {
        let Self { latest, frames, messages, bulk, channels, capabilities } = self;
        let (counters, address) = (frames.counters, frames.address);
        let others = channels.iter().map(|(_, connection)| &connection.counters);
        for other in [&latest.counters, &messages.counters, &bulk.counters].into_iter().chain(others) {
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
        let mut pulses = Vec::from(lanes);
        let channels = channels
            .into_iter()
            .map(|(declared, connection)| {
                let (channel, pulse) = connection.into_channel(net, &declared, &counters);
                pulses.push(pulse);
                channel
            })
            .collect();
        keep_alive(net, idle_timeout / 4, pulses);
        let latest_rx = LatestRx::new(latest.source, &counters);
        let lanes = AllLanes {
            latest: (Box::new(latest_tx), Box::new(latest_rx)),
            frames: (Box::new(frames_tx), Box::new(frames_rx)),
            messages: (Box::new(messages.0), Box::new(messages.1)),
            bulk: (Box::new(bulk.0), Box::new(bulk.1)),
        };
        let parts = LinkParts::new(lanes, peer, session, address, capabilities, counters);
        parts.with_channels(channels).with_idle_timeout(idle_timeout)
    }
}
