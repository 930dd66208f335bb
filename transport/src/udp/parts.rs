//! The parts of a link over a connection.

use std::sync::Arc;

use trimaran_wire::SessionId;

use super::frames::{FrameRx, FrameTx};
use super::latest::{LatestRx, LatestTx};
use super::port::{Carrier, Port};
use super::records::{RecordRx, RecordTx};
use crate::lanes;
use crate::lanes::records::RecordLane;
use crate::parts::LinkParts;
use crate::peer::{Peer, PeerAddress};
use crate::stats::Counters;
use crate::transport::Capabilities;

/// The parts of a link over a connection.
pub(super) fn parts(
    port: &Arc<Port>,
    encrypted: bool,
    peer: Peer,
    (session, reliable): (SessionId, bool),
    counters: Arc<Counters>,
) -> LinkParts {
    let carrier = Carrier::new(port);
    counters.watch(port.watch());
    let counts = &counters;
    let records = |lane| {
        let tx = RecordTx::new(&carrier, lane, counts);
        (Box::new(tx) as _, Box::new(RecordRx::new(&carrier, lane, counts)) as _)
    };
    let lanes = lanes::Lanes {
        latest: (Box::new(LatestTx::new(&carrier, counts)), Box::new(LatestRx::new(&carrier, counts))),
        frames: (Box::new(FrameTx::new(&carrier, counts)), Box::new(FrameRx::new(&carrier, counts))),
        messages: records(RecordLane::Messages),
        bulk: records(RecordLane::Bulk),
    };
    let (address, capabilities) =
        (PeerAddress::Udp(port.remote()), Capabilities { reliable, ordered: true, encrypted, local: false });
    LinkParts::new(lanes, peer, session, address, capabilities, counters)
}
