//! What every transport gives when its handshake is done.

use std::any::Any;

use trimaran_wire::SessionId;

use crate::handshake::HandshakeError;
use crate::lanes::frames::{WireFrameRx, WireFrameTx};
use crate::lanes::latest::{WireLatestRx, WireLatestTx};
use crate::lanes::records::{WireRecordRx, WireRecordTx};
use crate::lanes::shared::Shared;
use crate::peer::{Peer, PeerAddress};
use crate::transport::Capabilities;

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
    pub(crate) messages: (WireRecordTx, WireRecordRx),
    pub(crate) bulk: (WireRecordTx, WireRecordRx),
}

/// The lanes.
#[derive(Debug)]
pub(crate) enum Lanes {
    /// Of bytes.
    Wire(Box<Wire>),
    /// Of values: `inproc::Lanes` of the application's protocol.
    Local(Box<dyn Any + Send>),
}
