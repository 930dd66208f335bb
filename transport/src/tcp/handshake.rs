//! One connection during the handshake, and what it becomes.

use std::fmt;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use thiserror::Error;
use trimaran_proto::{DecodeError, DecodeFault, Hello, Identity, Kind, Message, Refusal, SessionId};

use crate::error::{LaneError, Loss, ProtocolError};
use crate::frames::{FrameRx, FrameTx};
use crate::latest::{LatestRx, LatestTx};
use crate::link::{Link, LinkConfig, PeerAddress, PeerInfo, Shared};
use crate::net::{Net, Stream};
use crate::patience::Patience;
use crate::stats::Counters;
use crate::stream::{self, Sink, Source};
use crate::{FrameReceiver, FrameSender, LatestReceiver, LatestSender};

/// How much is read at once from someone who is not a peer yet.
const ROOM: usize = 512;

/// Why a handshake failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum HandshakeError {
    /// The other side closed the connection.
    #[error("the connection was closed during the handshake")]
    Closed,
    /// The system reports an error.
    #[error("the connection failed during the handshake")]
    Io(#[source] io::Error),
    /// What came is not this protocol.
    #[error("the other side does not speak this protocol")]
    Decode(#[from] DecodeError),
    /// A message came that is no part of a handshake.
    #[error("a {kind} message came during the handshake")]
    Unexpected {
        /// The message.
        kind: Kind,
    },
    /// The other side refuses.
    #[error("refused: {0}")]
    Refused(Refusal),
    /// It took too long.
    #[error("the handshake took too long")]
    TimedOut,
}

impl From<LaneError> for HandshakeError {
    fn from(error: LaneError) -> Self {
        match error {
            LaneError::Lost(Loss::Io(e)) => Self::Io(e),
            LaneError::Lost(Loss::Closed | Loss::Cut { .. }) => Self::Closed,
            LaneError::Protocol(ProtocolError::Decode(e)) => Self::Decode(e),
            LaneError::Protocol(ProtocolError::Misplaced { kind, .. }) => Self::Unexpected { kind },
            LaneError::Protocol(ProtocolError::Frame(_)) => Self::Unexpected { kind: Kind::Ids },
            LaneError::Goodbye(_) => Self::Unexpected { kind: Kind::Goodbye },
            LaneError::Expired(_) => Self::TimedOut,
        }
    }
}

/// A connection on which the two sides introduce themselves.
#[derive(Debug)]
pub(super) struct Connection {
    source: Source,
    sink: Sink,
    pub(super) address: SocketAddr,
    counters: Arc<Counters>,
}

impl Connection {
    pub(super) fn new(stream: Stream, counters: &Arc<Counters>) -> Self {
        Self {
            source: Source::new(stream.reader, ROOM),
            sink: Sink::new(stream.writer),
            address: stream.peer,
            counters: Arc::clone(counters),
        }
    }

    pub(super) async fn send(&mut self, message: &Message) -> Result<(), HandshakeError> {
        self.sink.stage(message, &self.counters.sent);
        poll_fn(|cx| self.sink.poll_drain(cx)).await.map_err(HandshakeError::Io)
    }

    async fn recv(&mut self) -> Result<Message, HandshakeError> {
        loop {
            if let Some(message) = self.source.next_buffered(&self.counters.received)? {
                return Ok(message);
            }
            poll_fn(|cx| self.source.poll_fill(cx)).await?;
        }
    }

    /// Reads the hello of whoever connected. A peer of another version is refused here: no more of it can be read.
    pub(super) async fn recv_hello(&mut self) -> Result<Hello, HandshakeError> {
        match self.recv().await {
            Ok(Message::Hello(hello)) => Ok(hello),
            Ok(other) => Err(HandshakeError::Unexpected { kind: other.kind() }),
            Err(HandshakeError::Decode(e)) => {
                if let DecodeFault::Version { ours, theirs } = e.fault {
                    let refusal = Refusal::Version { listener: ours, connector: theirs };
                    self.refuse(refusal).await?;
                    return Err(HandshakeError::Refused(refusal));
                }
                Err(HandshakeError::Decode(e))
            }
            Err(e) => Err(e),
        }
    }

    /// Reads the answer to a hello.
    pub(super) async fn recv_answer(&mut self) -> Result<Identity, HandshakeError> {
        match self.recv().await? {
            Message::Accept(accept) => Ok(accept.identity),
            Message::Refuse(refusal) => Err(HandshakeError::Refused(refusal)),
            other => Err(HandshakeError::Unexpected { kind: other.kind() }),
        }
    }

    /// Says no, and that nothing more comes.
    pub(super) async fn refuse(&mut self, refusal: Refusal) -> Result<(), HandshakeError> {
        self.send(&Message::Refuse(refusal)).await?;
        poll_fn(|cx| self.sink.poll_shutdown(cx)).await.map_err(HandshakeError::Io)
    }
}

/// The two connections of a link whose handshake is done.
#[derive(Debug)]
pub(super) struct Lanes {
    pub(super) latest: Connection,
    pub(super) frames: Connection,
}

impl Lanes {
    pub(super) fn into_link(
        self,
        net: &Arc<dyn Net>,
        config: &LinkConfig,
        ours: &Identity,
        theirs: Identity,
        session: SessionId,
        place: Option<Arc<dyn fmt::Debug + Send + Sync>>,
    ) -> Link {
        let Self { latest, frames } = self;
        let counters = frames.counters;
        if !Arc::ptr_eq(&counters, &latest.counters) {
            counters.absorb(&latest.counters);
        }
        let shared = || Shared { peer: theirs.role, counters: Arc::clone(&counters), _place: place.clone() };
        let patience = || Patience::new(net, config.patience);
        let batch = config.batch_between(ours, &theirs);
        let latest_tx = LatestTx::Stream(stream::LatestTx::new(net, latest.sink, shared()));
        let latest_rx = LatestRx::Stream(stream::LatestRx::new(latest.source));
        let frame_tx = FrameTx::Stream(stream::FrameTx::new(frames.sink));
        let frame_rx = FrameRx::Stream(stream::FrameRx::new(frames.source));
        Link {
            peer: PeerInfo { identity: theirs, session, address: PeerAddress::Tcp(frames.address) },
            latest_tx: LatestSender { lane: latest_tx, shared: shared(), patience: patience() },
            latest_rx: LatestReceiver { lane: latest_rx, shared: shared(), patience: patience() },
            frames_tx: FrameSender::new(batch, frame_tx, shared(), patience()),
            frames_rx: FrameReceiver::new(frame_rx, shared(), patience()),
            stats: counters.handle(),
        }
    }
}
