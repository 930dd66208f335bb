//! TCP segments.

use bytes::Bytes;
use serde::Serialize;

/// A segment. Sequence numbers are counts of bytes since the start of the connection; they do not wrap here.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Segment {
    pub(crate) seq: u64,
    /// The next byte expected from the other side; none in the very first segment.
    pub(crate) ack: Option<u64>,
    pub(crate) syn: bool,
    pub(crate) fin: bool,
    pub(crate) rst: bool,
    /// The receive window, bytes.
    pub(crate) window: u32,
    /// Its sending time in milliseconds, and the newest timestamp that the sender has seen (RFC 7323).
    pub(crate) timestamp: u64,
    pub(crate) echo: u64,
    /// Ranges that arrived out of order or twice, the latest first.
    pub(crate) sacks: Vec<Range>,
    pub(crate) data: Bytes,
    pub(crate) class: Class,
}

/// A range of sequence numbers; the end is excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Range {
    pub(crate) from: u64,
    pub(crate) to: u64,
}

/// The purpose of a packet.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// A datagram of UDP.
    Datagram,
    /// A datagram of at most 64 bytes. In QUIC and this project's protocol headers and seal are half of that,
    /// so it is an acknowledgement, a keep-alive, or very little else.
    SmallDatagram,
    /// Data sent for the first time.
    #[default]
    Data,
    /// Data sent again.
    Retransmission,
    /// Only an acknowledgement, or a window.
    Acknowledgement,
    /// The beginning or the end of a connection.
    Handshake,
    /// A probe: is the peer still there, or has it room again.
    Probe,
}

/// The most ranges that fit beside the timestamp.
pub(super) const MOST_SACKS: usize = 3;

impl Segment {
    /// The TCP header: 20 bytes and its options, padded to whole words.
    pub(crate) fn header(&self) -> u32 {
        // Maximum segment size 4, selective acknowledgements permitted 2, timestamp 10, window scale 3, and
        // one of padding.
        const SYN_OPTIONS: u32 = 20;
        const TIMESTAMP: u32 = 12;
        if self.rst {
            return 20;
        }
        if self.syn {
            return 20 + SYN_OPTIONS;
        }
        let sacks = if self.sacks.is_empty() { 0 } else { 4 + 8 * self.sacks.len() as u32 };
        20 + TIMESTAMP + sacks
    }

    /// How many sequence numbers it takes.
    pub(crate) fn length(&self) -> u64 {
        self.data.len() as u64 + u64::from(self.syn) + u64::from(self.fin)
    }

    pub(crate) fn end(&self) -> u64 {
        self.seq + self.length()
    }
}

/// The data of a full segment for this MTU.
pub(super) const fn full_size(mtu: u32, ip_header: u32) -> u32 {
    mtu.saturating_sub(ip_header + 20 + 12)
}
