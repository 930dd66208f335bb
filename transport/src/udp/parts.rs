//! The parts of a link over a connection.

use std::fmt;
use std::sync::Arc;

use trimaran_wire::{Format, SessionId};

use super::frames::{FrameRx, FrameTx};
use super::latest::{LatestRx, LatestTx};
use super::options::UdpOptions;
use super::port::{Carrier, Port};
use super::records::{RecordRx, RecordTx};
use crate::lanes;
use crate::lanes::records::RecordLane;
use crate::lanes::shared::Shared;
use crate::parts::{Lanes, Parts};
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
    let counts = &counters;
    let records = |lane| {
        let tx = RecordTx::new(&carrier, lane, counts);
        (Box::new(tx) as _, Box::new(RecordRx::new(&carrier, lane, counts)) as _)
    };
    let lanes = Lanes::Wire(lanes::Lanes {
        latest: (Box::new(LatestTx::new(&carrier, counts)), Box::new(LatestRx::new(&carrier, counts))),
        frames: (Box::new(FrameTx::new(&carrier, counts)), Box::new(FrameRx::new(&carrier, counts))),
        messages: records(RecordLane::Messages),
        bulk: records(RecordLane::Bulk),
    });
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
        idle_timeout: None,
        doubt: None,
    }
}
