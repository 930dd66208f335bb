//! Bytes on the wire in a simulated session, by kind, beside the formulas.

use std::collections::BTreeMap;
use std::ops::{Add, Sub};

use serde::Serialize;
use trimaran_netsim::{Class, WireTally};
use trimaran_proto::SentBytes;

use crate::report::FrameLoad;

/// The header that the paper counts around each packet: TCP, IP and Ethernet, 50 bytes (section 3.3).
const PAPER_HEADER: f64 = 50.0;

/// Bytes a frame over all links, as machines sent them, by kind.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FrameBytes {
    /// All bytes.
    pub total: f64,
    /// Ids: 4 bytes each where they travel plain.
    pub ids: f64,
    /// Geometry for a display without the scene, and the display's messages about it.
    pub geometry: f64,
    /// The other messages, and the headers of all of them.
    pub messages: f64,
    /// The transport's bytes beside messages: in datagrams its own headers, acknowledgements, retransmissions
    /// and authentication tags; in TCP retransmissions.
    pub transport: f64,
    /// The headers of TCP or UDP.
    pub transport_headers: f64,
    /// The headers of IP.
    pub ip_headers: f64,
    /// The bytes of the link layer, such as Ethernet.
    pub link_layer: f64,
    /// Packets a frame.
    pub packets: f64,
    /// Headers of TCP or UDP, IP and the link layer around each packet: `h` in the formulas.
    pub header: f64,
    /// Of all bytes, those in packets that only acknowledge: in TCP, or datagrams of at most 64 bytes, which
    /// may also hold a few ids.
    pub acknowledgements: f64,
    /// Of all bytes, those in TCP retransmissions.
    pub repetitions: f64,
    /// Of all bytes, those in TCP keep-alive packets.
    pub keepalive: f64,
    /// Bytes before the first frame, in total and not per frame: connections and their handshakes.
    pub handshake: f64,
    /// The paper's formula `8 (nh/b) + 3 (72 + h)`, with its `h` of 50.
    pub paper: f64,
    /// The formula with ids and headers added: `r (4n + hn/b) + (r + 1) (72 + h)`.
    pub corrected: f64,
    /// The same with the measured `h`.
    pub corrected_as_measured: f64,
}

/// The bytes sent in some time.
#[derive(Debug, Clone, Default)]
pub(super) struct Sent {
    pub(super) wire: BTreeMap<Class, WireTally>,
    pub(super) messages: SentBytes,
}

impl Sent {
    pub(super) fn add_packets(&mut self, class: Class, tally: WireTally) {
        *self.wire.entry(class).or_default() += tally;
    }

    /// All bytes on the wire.
    pub(super) fn bytes(&self) -> u64 {
        self.wire.values().map(WireTally::bytes).sum()
    }
}

impl Add for Sent {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        for (class, tally) in other.wire {
            self.add_packets(class, tally);
        }
        self.messages = self.messages + other.messages;
        self
    }
}

impl Sub for Sent {
    type Output = Self;

    fn sub(mut self, earlier: Self) -> Self {
        for (class, tally) in &mut self.wire {
            *tally = *tally - earlier.wire.get(class).copied().unwrap_or_default();
        }
        self.messages = self.messages - earlier.messages;
        self
    }
}

/// The bytes of one session, or of several alike.
#[derive(Debug, Clone, Default)]
pub(super) struct Account {
    /// How many sessions.
    pub(super) sessions: u32,
    /// How many frames they showed.
    pub(super) frames: u32,
    /// From the first camera to the last picture.
    pub(super) sent: Sent,
    /// Bytes before that.
    pub(super) before: u64,
}

impl Add for Account {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            sessions: self.sessions + other.sessions,
            frames: self.frames + other.frames,
            sent: self.sent + other.sent,
            before: self.before + other.before,
        }
    }
}

impl FrameBytes {
    /// For frames with `nodes` ids in batches of `batch`, sent to this many `receivers`.
    pub(super) fn of(account: &Account, nodes: f64, batch: usize, receivers: u8) -> Self {
        let Account { sessions, frames, sent, before } = account;
        let all = sent.wire.values().fold(WireTally::default(), |all, tally| all + *tally);
        let of = |class| sent.wire.get(&class).map_or(0, WireTally::bytes);
        let each = |bytes: u64| bytes as f64 / f64::from((*frames).max(1));
        let SentBytes { ids, geometry, .. } = sent.messages;
        let header = all.headers() as f64 / all.packets.max(1) as f64;
        let load = FrameLoad { ids: nodes, batch: batch as f64, header: PAPER_HEADER, receivers };
        Self {
            total: each(all.bytes()),
            ids: each(ids),
            geometry: each(geometry),
            messages: each(sent.messages.total().saturating_sub(ids + geometry)),
            transport: each(all.payload.saturating_sub(sent.messages.total())),
            transport_headers: each(all.transport_headers),
            ip_headers: each(all.ip_headers),
            link_layer: each(all.link_layer),
            packets: each(all.packets),
            header,
            acknowledgements: each(of(Class::Acknowledgement) + of(Class::SmallDatagram)),
            repetitions: each(of(Class::Retransmission)),
            keepalive: each(of(Class::Probe)),
            handshake: *before as f64 / f64::from((*sessions).max(1)),
            paper: load.paper_bytes(),
            corrected: load.sent_bytes(),
            corrected_as_measured: FrameLoad { header, ..load }.sent_bytes(),
        }
    }
}
