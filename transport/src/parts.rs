//! The result of every handshake.

use std::any::Any;

use trimaran_wire::SessionId;

use crate::handshake::HandshakeError;
use crate::lanes::frames::{WireFrameRx, WireFrameTx};
use crate::lanes::latest::{WireLatestRx, WireLatestTx};
use crate::lanes::records::{WireRecordRx, WireRecordTx};
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
    /// Why this side refuses the peer after all; the peer is told.
    pub(crate) doubt: Option<HandshakeError>,
}

/// The lanes as bytes.
#[derive(Debug)]
pub(crate) struct Wire {
    pub(crate) latest: (WireLatestTx, WireLatestRx),
    pub(crate) frames: (WireFrameTx, WireFrameRx),
    pub(crate) messages: (WireRecordTx, WireRecordRx),
    pub(crate) bulk: (WireRecordTx, WireRecordRx),
}

/// The lanes.
#[derive(Debug)]
pub(crate) enum Lanes {
    /// Lanes of bytes.
    Wire(Box<Wire>),
    /// Lanes of values: `inproc::Lanes` of the application's protocol.
    Local(Box<dyn Any + Send>),
}
