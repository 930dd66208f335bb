//! What two peers share after the handshake.

use std::any::Any;
use std::fmt;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use trimaran_wire::{BatchSize, Batching, CloseReason, Format, Protocol, SessionId};

use crate::application::{Peer, PeerName};
use crate::frames::{FrameRx, FrameTx, WireFrameRx, WireFrameTx};
use crate::handshake::HandshakeError;
use crate::inproc;
use crate::latest::{LatestRx, LatestTx, WireLatestRx, WireLatestTx};
use crate::messages::{MessageRx, MessageTx, WireMessageRx, WireMessageTx};
use crate::rates::Messages;
use crate::stats::Counters;
use crate::timeouts::Timeouts;
use crate::transport::Transport;
use crate::{
    FrameReceiver, FrameSender, LatestReceiver, LatestSender, MessageReceiver, MessageSender, RecvError,
    SendError, StatsHandle,
};
use trimaran_net::{Credentials, Net, StreamPeer, until};

/// How long a peer that leaves waits for the other one to leave as well.
const LINGER: Duration = Duration::from_millis(500);

/// A link to a peer: a lane for the latest value, a lane for frames of items and a lane for messages, each in
/// both directions.
///
/// The halves are independent: take the struct apart and use each where it is needed, from any thread.
/// Waiting calls work inside a runtime as well as under `Handle::block_on` on a thread of the caller's.
///
/// A link that is dropped without [`Link::close`] looks to the peer like a crash.
#[derive(Debug)]
pub struct Link<P: Protocol> {
    /// Who is at the other end.
    pub peer: PeerInfo<P>,
    /// Publishes the latest value.
    pub latest_tx: LatestSender<P>,
    /// Reads the newest value.
    pub latest_rx: LatestReceiver<P>,
    /// Sends frames of items.
    pub frames_tx: FrameSender<P>,
    /// Receives frames of items.
    pub frames_rx: FrameReceiver<P>,
    /// Sends messages.
    pub messages_tx: MessageSender<P>,
    /// Receives messages.
    pub messages_rx: MessageReceiver<P>,
    /// Counts what travels, for reading at any time.
    pub stats: StatsHandle,
    pub(crate) capabilities: Capabilities,
    net: Arc<dyn Net>,
}

/// Who is at the other end of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct PeerInfo<P: Protocol> {
    /// What messages and logs call it.
    pub name: PeerName,
    /// How it introduced itself.
    pub hello: P::Hello,
    /// The link's session id.
    pub session: SessionId,
    /// Where it was when the link was made: over datagrams and QUIC it may go elsewhere.
    pub address: PeerAddress,
}

/// Where a peer is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PeerAddress {
    /// In this process.
    InProcess,
    /// At the other end of TCP connections; the port is that of the frames lane.
    Tcp(SocketAddr),
    /// At the other end of Unix sockets of this machine.
    Unix(Credentials),
    /// Behind datagrams of this crate's own protocol.
    Udp(SocketAddr),
    /// At the other end of a QUIC connection.
    Quic(SocketAddr),
    /// At the other end of byte streams of a [`Transport`] from outside this crate.
    Other {
        /// The transport's scheme.
        scheme: &'static str,
        /// Where, as the transport says.
        at: StreamPeer,
    },
}

/// What a link's transport promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capabilities {
    /// Every frame arrives complete, or the link ends.
    pub reliable: bool,
    /// Frames arrive in the order sent, none before all of the one before.
    pub ordered: bool,
    /// Nobody on the way can read or change what travels.
    pub encrypted: bool,
    /// The peer is on this machine.
    pub local: bool,
}

impl PeerAddress {
    /// The peer of a byte stream of `transport`.
    pub(crate) fn over(transport: &dyn Transport, peer: StreamPeer) -> Self {
        match (transport.scheme(), peer) {
            ("tcp", StreamPeer::Tcp(at)) => Self::Tcp(at),
            ("unix", StreamPeer::Unix(process)) => Self::Unix(process),
            (scheme, at) => Self::Other { scheme, at },
        }
    }

    /// The transport that leads there, as [`Endpoint::transport`](crate::Endpoint::transport) names it.
    #[must_use]
    pub const fn transport(&self) -> &'static str {
        match self {
            Self::InProcess => "inproc",
            Self::Tcp(_) => "tcp",
            Self::Unix(_) => "unix",
            Self::Udp(_) => "udp",
            Self::Quic(_) => "quic",
            Self::Other { scheme, .. } => scheme,
        }
    }
}

impl fmt::Display for PeerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::InProcess => f.write_str("this process"),
            Self::Tcp(address)
            | Self::Udp(address)
            | Self::Quic(address)
            | Self::Other { at: StreamPeer::Tcp(address), .. } => address.fmt(f),
            Self::Unix(process) | Self::Other { at: StreamPeer::Unix(process), .. } => match process {
                Credentials { uid, pid: Some(pid), .. } => write!(f, "process {pid} of user {uid}"),
                Credentials { uid, pid: None, .. } => write!(f, "a process of user {uid}"),
            },
        }
    }
}

/// What holds for a link whatever its transport.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
pub struct LinkConfig {
    /// How long any one wait for the peer may last: longer than the peer's longest pause between two
    /// messages, loading and first frame included. Default 30 s.
    #[cfg_attr(
        feature = "config",
        serde(rename = "timeout_s", with = "trimaran_net::config::seconds"),
        schemars(with = "f64")
    )]
    pub timeout: Duration,
    /// The silence after which the peer counts as lost, whatever the transport: it shows keep-alives while
    /// it has nothing to say, as long as its process runs. Time in which nobody waits for the peer does
    /// not count. Both sides should have the same, or 20 s and more. Default 20 s.
    #[cfg_attr(
        feature = "config",
        serde(rename = "idle_timeout_s", with = "crate::config::idle_timeout_s"),
        schemars(with = "f64")
    )]
    pub idle_timeout: Duration,
    /// How long one handshake may take, from the connection to the last answer. Default 5 s.
    #[cfg_attr(
        feature = "config",
        serde(rename = "handshake_timeout_s", with = "trimaran_net::config::seconds"),
        schemars(with = "f64")
    )]
    pub handshake_timeout: Duration,
    /// How items travel, where the peers' hellos do not say so. Within one process they are not coded.
    /// Default batches of 256, plain.
    #[cfg_attr(feature = "config", serde(skip))]
    pub batching: Batching,
    /// How many items a frame may have at most, sent or received: a peer that sends more breaks the protocol,
    /// and is found out before room is made for them. Give what the application can have. Default 4,194,304.
    #[cfg_attr(feature = "config", serde(skip))]
    pub max_frame: u32,
    /// How many messages the peer may send on the frames lane in a second, measured over that many, and on the
    /// messages lane: one that sends more is no peer but a flood, and the lane fails. Of latest values only the newest is read anyway.
    /// Not within one process. Default 1,000,000.
    #[cfg_attr(feature = "config", serde(deserialize_with = "crate::config::above_zero"))]
    pub messages_per_s: u32,
}

impl Default for LinkConfig {
    fn default() -> Self {
        Self {
            timeout: Duration::from_secs(30),
            idle_timeout: Duration::from_secs(20),
            handshake_timeout: Duration::from_secs(5),
            batching: Batching { size: BatchSize::default(), coded: false },
            max_frame: 1 << 22,
            messages_per_s: 1_000_000,
        }
    }
}

impl LinkConfig {
    /// The pause after which a lane that has nothing to say shows a keep-alive: often enough for a peer of
    /// the default idle timeout.
    pub(crate) fn keepalive(&self) -> Duration {
        (self.idle_timeout / 4).min(Duration::from_secs(5))
    }
}

impl<P: Protocol> Link<P> {
    /// What the link's transport promises.
    #[must_use]
    pub const fn capabilities(&self) -> Capabilities {
        self.capabilities
    }

    /// Leaves in good order: closes the link on each lane, and waits a moment (half a second at most) for the
    /// peer to leave as well, or for what was said to arrive when the peer has left already. What still
    /// comes from it is thrown away.
    ///
    /// Dropping the future drops the link: the peer may have heard the close on some lanes only or on
    /// none, and then takes this side for lost.
    ///
    /// # Errors
    /// When the peer is gone without a close of its own, or takes nothing within the link's timeout.
    pub async fn close(self, reason: CloseReason) -> Result<(), SendError> {
        let Self { peer, latest_tx, mut latest_rx, frames_tx, mut frames_rx, .. } = self;
        let (messages_tx, mut messages_rx, net) = (self.messages_tx, self.messages_rx, self.net);
        let say = async {
            let (frames, latest, messages) = tokio::join!(
                frames_tx.close(reason.clone()),
                latest_tx.close(reason.clone()),
                messages_tx.close(reason.clone())
            );
            frames.and(latest).and(messages)
        };
        // A connection that is closed while it holds unread data is reset, and on some systems the reset
        // overtakes the close on the peer's side. So whatever comes is read until the peer closes.
        let hear = async {
            let (frames, latest, messages) =
                tokio::join!(frames_rx.drain(), latest_rx.drain(), messages_rx.drain());
            let ends = [frames, latest, messages];
            (ends.iter().any(|end| matches!(end, RecvError::Closed { .. })), latest_rx)
        };
        let (mut say, mut hear) = (pin!(say), pin!(hear));
        let soon = || net.now().after(LINGER);
        let (said, heard) = tokio::select! {
            biased;
            said = &mut say => {
                if said.is_ok() && peer.address == PeerAddress::InProcess {
                    return Ok(());
                }
                (said, until(&*net, soon(), hear).await)
            }
            heard = &mut hear => {
                let said = match heard {
                    // It may be unable to tell that all has arrived, and what has not by then nobody reads.
                    (true, _) => until(&*net, soon(), say).await.unwrap_or(Ok(())),
                    (false, _) => say.await,
                };
                (said, Some(heard))
            }
        };
        let Some((has_left, lane)) = heard else { return said };
        lane.part().await;
        // It may leave between the close on one lane and that on the other.
        if has_left { Ok(()) } else { said }
    }
}

/// What a transport has when its handshake is done: a link but for its types.
#[derive(Debug)]
pub(crate) struct Parts {
    pub(crate) lanes: Lanes,
    pub(crate) peer: Peer,
    pub(crate) session: SessionId,
    pub(crate) address: PeerAddress,
    pub(crate) capabilities: Capabilities,
    pub(crate) shared: Shared,
    /// Why this side does not take the peer after all: it is told so.
    pub(crate) doubt: Option<HandshakeError>,
}

/// The lanes where values travel as bytes.
#[derive(Debug)]
pub(crate) struct Wire {
    pub(crate) latest: (WireLatestTx, WireLatestRx),
    pub(crate) frames: (WireFrameTx, WireFrameRx),
    pub(crate) messages: (WireMessageTx, WireMessageRx),
}

/// The lanes.
#[derive(Debug)]
pub(crate) enum Lanes {
    /// Of bytes.
    Wire(Box<Wire>),
    /// Of values: `inproc::Lanes` of the application's protocol.
    Local(Box<dyn Any + Send>),
}

impl Parts {
    /// The link, if its peer speaks `P`: the handshake has seen to that.
    pub(crate) fn into_link<P: Protocol>(self, net: &Arc<dyn Net>, config: &LinkConfig) -> Option<Link<P>> {
        let Self { lanes, peer, session, address, capabilities, shared, .. } = self;
        let hello = postcard::from_bytes(&peer.hello).ok()?;
        let local = address == PeerAddress::InProcess;
        let most = if local { u32::MAX } else { config.messages_per_s };
        let timeouts = || Timeouts::new(net, config.timeout, config.idle_timeout);
        let batching = peer.batching.unwrap_or(config.batching);
        let (latest, frames, messages) = match lanes {
            Lanes::Wire(wire) => (
                (LatestTx::Wire(wire.latest.0), LatestRx::Wire(Box::new(wire.latest.1))),
                (FrameTx::Wire(wire.frames.0), FrameRx::Wire(wire.frames.1)),
                (MessageTx::Wire(wire.messages.0), MessageRx::Wire(wire.messages.1)),
            ),
            Lanes::Local(lanes) => {
                let inproc::Lanes { latest, frames, messages } =
                    *lanes.downcast::<inproc::Lanes<P>>().ok()?;
                (
                    (LatestTx::Local(latest.0), LatestRx::Local(latest.1)),
                    (FrameTx::Local(frames.0), FrameRx::Local(frames.1)),
                    (MessageTx::Local(messages.0), MessageRx::Local(messages.1)),
                )
            }
        };
        let (max_frame, rate) = (config.max_frame, || Messages::new(most));
        Some(Link {
            peer: PeerInfo { name: peer.name, hello, session, address },
            capabilities,
            net: Arc::clone(net),
            stats: shared.counters.handle(),
            latest_tx: LatestSender { lane: latest.0, shared: shared.clone(), timeouts: timeouts() },
            latest_rx: LatestReceiver { lane: latest.1, shared: shared.clone(), timeouts: timeouts() },
            frames_tx: FrameSender::new(
                batching,
                max_frame,
                capabilities,
                frames.0,
                shared.clone(),
                timeouts(),
            ),
            frames_rx: FrameReceiver::new(max_frame, frames.1, shared.clone(), timeouts(), rate()),
            messages_tx: MessageSender { lane: messages.0, shared: shared.clone(), timeouts: timeouts() },
            messages_rx: MessageReceiver {
                lane: messages.1,
                shared,
                timeouts: Timeouts::new(net, Duration::MAX, config.idle_timeout),
                rate: rate(),
            },
        })
    }
}

/// What the halves of a link have in common.
#[derive(Debug, Clone)]
pub(crate) struct Shared {
    pub(crate) peer: PeerName,
    pub(crate) format: Format,
    pub(crate) counters: Arc<Counters>,
    /// Dropped with the last half.
    pub(crate) _place: Option<Arc<dyn fmt::Debug + Send + Sync>>,
}
