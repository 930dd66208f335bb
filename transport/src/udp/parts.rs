//! The parts of a link over a connection.

use std::fmt;
use std::sync::Arc;

use trimaran_wire::{Format, SessionId};

use super::frames::{FrameRx, FrameTx};
use super::latest::{LatestRx, LatestTx};
use super::options::UdpOptions;
use super::port::{Carrier, Port};
use super::records::{RecordRx, RecordTx};
use crate::lanes::frames::{WireFrameRx, WireFrameTx};
use crate::lanes::latest::{WireLatestRx, WireLatestTx};
use crate::lanes::records::{RecordLane, WireRecordRx, WireRecordTx};
use crate::lanes::shared::Shared;
use crate::parts::{Lanes, Parts, Wire};
use crate::peer::{Peer, PeerAddress};
use crate::stats::Counters;
use crate::transport::Capabilities;

/// The parts of a link over a connection.
pub(super) fn parts(
    port: &Arc<Port>,
    options: &UdpOptions,
    format: Format,
    peer: Peer,
    (session, reliable): (SessionId, bool),
    counters: Arc<Counters>,
    place: Option<Arc<dyn fmt::Debug + Send + Sync>>,
) -> Parts {
    let carrier = Carrier::new(port);
    counters.watch(port.watch());
    let records = |lane| {
        (WireRecordTx::Udp(RecordTx::new(&carrier, lane)), WireRecordRx::Udp(RecordRx::new(&carrier, lane)))
    };
    let lanes = Lanes::Wire(Box::new(Wire {
        latest: (WireLatestTx::Udp(LatestTx::new(&carrier)), WireLatestRx::Udp(LatestRx::new(&carrier))),
        frames: (WireFrameTx::Udp(FrameTx::new(&carrier)), WireFrameRx::Udp(FrameRx::new(&carrier))),
        messages: records(RecordLane::Messages),
        bulk: records(RecordLane::Bulk),
    }));
    Parts {
        lanes,
        session,
        address: PeerAddress::Udp(port.remote()),
        capabilities: Capabilities {
            reliable,
            ordered: true,
            encrypted: options.is_encrypted(),
            local: false,
        },
        shared: Shared { peer: peer.name.clone(), format, counters, _place: place },
        peer,
        doubt: None,
    }
}
