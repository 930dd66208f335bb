//! The result of every handshake.

use std::any::Any;
use std::time::Duration;

use bytes::Bytes;
use trimaran_wire::{FixedBytes, FrameMessage, SessionId};

use crate::handshake::HandshakeError;
use crate::lanes;
use crate::lanes::shared::Shared;
use crate::peer::{Peer, PeerAddress};
use crate::transport::Capabilities;

/// The result of a handshake: a link without its types.
#[derive(Debug)]
pub(crate) struct Parts {
    pub(crate) lanes: Lanes,
    pub(crate) peer: Peer,
    pub(crate) session: SessionId,
    pub(crate) address: PeerAddress,
    pub(crate) capabilities: Capabilities,
    pub(crate) shared: Shared,
    /// The idle timeout, if the transport leaves it to the link to notice that the peer is silent.
    pub(crate) idle_timeout: Option<Duration>,
    /// Why this side refuses the peer after all; the peer is told.
    pub(crate) doubt: Option<HandshakeError>,
}

/// Lanes of bytes.
pub(crate) type ByteLanes = lanes::Lanes<FixedBytes, FrameMessage, Bytes, Bytes>;

/// The lanes.
#[derive(Debug)]
pub(crate) enum Lanes {
    /// Lanes of bytes.
    Wire(ByteLanes),
    /// Lanes of values: `LocalLanes` of the application's protocol.
    Local(Box<dyn Any + Send>),
}
