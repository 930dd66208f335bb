//! The parts of a link over a connection.

use std::sync::Arc;

use trimaran_udp::UnitLane;
use trimaran_wire::{Channel, ChannelNumber, ChannelSizes, FixedBytes, FrameMessage, SessionId};

use super::frames::{FrameRx, FrameTx};
use super::latest::{LatestRx, LatestTx};
use super::port::{Carrier, Port};
use super::records::{RecordRx, RecordTx};
use crate::lanes::half::Duplex;
use crate::lanes::records::RecordLane;
use crate::lanes::{self, ByteChannel};
use crate::parts::LinkParts;
use crate::peer::{Peer, PeerAddress};
use crate::stats::Counters;
use crate::transport::Capabilities;

/// The parts of a link over a connection.
pub(super) fn parts(
    port: &Arc<Port>,
    encrypted: bool,
    peer: Peer,
    (session, reliable, channels): (SessionId, bool, &[Channel]),
    counters: Arc<Counters>,
) -> LinkParts {
    let carrier = Carrier::new(port);
    counters.watch(port.watch());
    let counts = &counters;
    let records = |lane| {
        let tx = RecordTx::new(&carrier, lane, counts);
        (Box::new(tx) as _, Box::new(RecordRx::new(&carrier, lane, counts)) as _)
    };
    let latest = |channel| -> Duplex<FixedBytes> {
        let tx = LatestTx::new(&carrier, channel, counts);
        (Box::new(tx), Box::new(LatestRx::new(&carrier, channel, counts)))
    };
    let frames = |lane| -> Duplex<FrameMessage> {
        (Box::new(FrameTx::new(&carrier, lane, counts)), Box::new(FrameRx::new(&carrier, lane, counts)))
    };
    let channels = (0..)
        .map(ChannelNumber)
        .zip(channels)
        .map(|(number, channel)| match channel.sizes() {
            ChannelSizes::Latest { .. } => ByteChannel::Latest(latest(Some(number))),
            ChannelSizes::Frames { .. } => ByteChannel::Frames(frames(UnitLane::Channel(number))),
        })
        .collect();
    let lanes = lanes::Lanes {
        latest: latest(None),
        frames: frames(UnitLane::Frames),
        messages: records(RecordLane::Messages),
        bulk: records(RecordLane::Bulk),
    };
    let (address, capabilities) =
        (PeerAddress::Udp(port.remote()), Capabilities { reliable, ordered: true, encrypted, local: false });
    LinkParts::new(lanes, peer, session, address, capabilities, counters).with_channels(channels)
}
