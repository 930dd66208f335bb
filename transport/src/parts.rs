//! The result of every handshake.

use std::any::Any;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use trimaran_wire::{FixedBytes, FrameMessage, SessionId};

use crate::handshake::HandshakeError;
use crate::lanes::{self, ByteChannel};
use crate::peer::{Peer, PeerAddress};
use crate::stats::Counters;
use crate::transport::Capabilities;

/// The result of a handshake: a link without its types.
#[derive(Debug)]
pub struct LinkParts {
    pub(crate) lanes: Lanes,
    pub(crate) channels: Vec<ByteChannel>,
    pub(crate) peer: Peer,
    pub(crate) session: SessionId,
    pub(crate) address: PeerAddress,
    pub(crate) capabilities: Capabilities,
    pub(crate) counters: Arc<Counters>,
    pub(crate) idle_timeout: Option<Duration>,
    /// Dropped with the last half.
    pub(crate) place: Option<Arc<dyn fmt::Debug + Send + Sync>>,
    /// Why this side refuses the peer after all; the peer is told.
    pub(crate) doubt: Option<HandshakeError>,
}

impl LinkParts {
    /// A link over lanes of bytes, which count their traffic in `counters`.
    #[must_use]
    pub fn new(
        lanes: ByteLanes,
        peer: Peer,
        session: SessionId,
        address: PeerAddress,
        capabilities: Capabilities,
        counters: Arc<Counters>,
    ) -> Self {
        Self::over(Lanes::Wire(lanes), peer, session, address, capabilities, counters)
    }

    pub(crate) fn over(
        lanes: Lanes,
        peer: Peer,
        session: SessionId,
        address: PeerAddress,
        capabilities: Capabilities,
        counters: Arc<Counters>,
    ) -> Self {
        let (channels, idle_timeout, place, doubt) = (Vec::new(), None, None, None);
        Self { lanes, channels, peer, session, address, capabilities, counters, idle_timeout, place, doubt }
    }

    /// The link has these channels, in the order of [`Format::channels`](crate::Format): one for each.
    #[must_use]
    pub fn with_channels(self, channels: Vec<ByteChannel>) -> Self {
        Self { channels, ..self }
    }

    /// The link itself notices that a peer is silent: nothing has come to a receiving half for so long, and a
    /// waiting sender has not [heard](crate::Half::heard) anything. By default the transport does.
    #[must_use]
    pub fn with_idle_timeout(self, idle_timeout: Duration) -> Self {
        Self { idle_timeout: Some(idle_timeout), ..self }
    }

    /// The link keeps `place` until its last half is dropped: a [`Place`](crate::Place) at a listener.
    #[must_use]
    pub fn holding(self, place: impl fmt::Debug + Send + Sync + 'static) -> Self {
        Self { place: Some(Arc::new(place)), ..self }
    }
}

/// Lanes of bytes.
pub type ByteLanes = lanes::Lanes<FixedBytes, FrameMessage, Bytes, Bytes>;

/// The lanes.
#[derive(Debug)]
pub(crate) enum Lanes {
    /// Lanes of bytes.
    Wire(ByteLanes),
    /// Lanes of values: `LocalLanes` of the application's protocol.
    #[cfg_attr(not(feature = "inproc"), allow(dead_code, reason = "only inproc makes them"))]
    Local(Box<dyn Any + Send>),
}
