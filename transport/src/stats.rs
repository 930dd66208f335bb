//! Traffic over a link, by cause.

use std::ops::{Add, Sub};

#[cfg(feature = "udp")]
use trimaran_udp::PathStats;

mod counters;

#[cfg(feature = "udp")]
pub(crate) use counters::PathSource;
pub use counters::{Counters, Direction, StatsHandle};

/// Traffic over a link since it was made, handshake included.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct LinkStats {
    /// Sent by this side.
    pub sent: Traffic,
    /// Received by this side.
    pub received: Traffic,
    /// How often the peer sent more messages in a second than it [may](crate::LinkConfig::messages_per_s):
    /// each time the lane failed.
    pub floods: u64,
    /// Frames that came and were not returned to their reader. Counted where it takes frames as a whole, or
    /// only the last ones.
    pub skipped: Skipped,
    /// Packets and the path they take, over datagrams of this crate's own protocol. Other transports have
    /// none.
    #[cfg(feature = "udp")]
    pub path: Option<PathStats>,
}

/// Frames that came and were not returned to their reader, by cause.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Skipped {
    /// A newer frame took their place: their reader is slower than the peer.
    pub replaced: u64,
    /// They had waited longer than their lifespan.
    pub expired: u64,
    /// They lacked items that were given up on a link with deadlines.
    pub incomplete: u64,
}

impl Skipped {
    pub(crate) const REPLACED: Self = Self { replaced: 1, expired: 0, incomplete: 0 };
    pub(crate) const EXPIRED: Self = Self { replaced: 0, expired: 1, incomplete: 0 };
    pub(crate) const INCOMPLETE: Self = Self { replaced: 0, expired: 0, incomplete: 1 };

    /// How many, for whatever cause.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.replaced + self.expired + self.incomplete
    }
}

impl Add for Skipped {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            replaced: self.replaced + other.replaced,
            expired: self.expired + other.expired,
            incomplete: self.incomplete + other.incomplete,
        }
    }
}

impl Sub for Skipped {
    type Output = Self;

    fn sub(self, earlier: Self) -> Self {
        Self {
            replaced: self.replaced.saturating_sub(earlier.replaced),
            expired: self.expired.saturating_sub(earlier.expired),
            incomplete: self.incomplete.saturating_sub(earlier.incomplete),
        }
    }
}

/// Messages and payload bytes by kind, in one direction.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Traffic {
    /// Values of the latest lane.
    pub latest: Tally,
    /// Beginnings of frames, with their headers.
    pub begin: Tally,
    /// Batches of items, plain or coded.
    pub batches: Tally,
    /// The number of items.
    pub items: u64,
    /// Ends of frames (EOF).
    pub end: Tally,
    /// Messages of the messages lane.
    pub messages: Tally,
    /// Blocks of the bulk lane.
    pub bulk: Tally,
    /// Handshake, close and keep-alives; within one process these have no size.
    pub control: Tally,
    /// The bytes of this protocol's own headers; those of TCP, IP and Ethernet are not known here. 0 where
    /// messages have no headers of their own: in one process, and over datagrams, whose packets
    /// [`LinkStats::path`] counts.
    pub header_bytes: u64,
}

/// Messages and their payload.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Tally {
    /// How many messages.
    pub messages: u64,
    /// Their payload in bytes, headers not counted.
    pub bytes: u64,
}

impl Traffic {
    /// All bytes: payloads and headers.
    #[must_use]
    pub const fn total_bytes(&self) -> u64 {
        self.latest.bytes
            + self.begin.bytes
            + self.batches.bytes
            + self.end.bytes
            + self.messages.bytes
            + self.bulk.bytes
            + self.control.bytes
            + self.header_bytes
    }
}

impl Sub for LinkStats {
    type Output = Self;

    /// The difference to the earlier snapshot `earlier`. The state of the path stays as it is.
    fn sub(self, earlier: Self) -> Self {
        Self {
            sent: self.sent - earlier.sent,
            received: self.received - earlier.received,
            floods: self.floods.saturating_sub(earlier.floods),
            skipped: self.skipped - earlier.skipped,
            #[cfg(feature = "udp")]
            path: self.path.map(|path| path.since(&earlier.path.unwrap_or_default())),
        }
    }
}

impl Add for Traffic {
    type Output = Self;

    /// The sum of both, such as of both directions of a link.
    fn add(self, other: Self) -> Self {
        Self {
            latest: self.latest + other.latest,
            begin: self.begin + other.begin,
            batches: self.batches + other.batches,
            items: self.items + other.items,
            end: self.end + other.end,
            messages: self.messages + other.messages,
            bulk: self.bulk + other.bulk,
            control: self.control + other.control,
            header_bytes: self.header_bytes + other.header_bytes,
        }
    }
}

impl Sub for Traffic {
    type Output = Self;

    fn sub(self, earlier: Self) -> Self {
        Self {
            latest: self.latest - earlier.latest,
            begin: self.begin - earlier.begin,
            batches: self.batches - earlier.batches,
            items: self.items.saturating_sub(earlier.items),
            end: self.end - earlier.end,
            messages: self.messages - earlier.messages,
            bulk: self.bulk - earlier.bulk,
            control: self.control - earlier.control,
            header_bytes: self.header_bytes.saturating_sub(earlier.header_bytes),
        }
    }
}

impl Add for Tally {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { messages: self.messages + other.messages, bytes: self.bytes + other.bytes }
    }
}

impl Sub for Tally {
    type Output = Self;

    fn sub(self, earlier: Self) -> Self {
        Self {
            messages: self.messages.saturating_sub(earlier.messages),
            bytes: self.bytes.saturating_sub(earlier.bytes),
        }
    }
}
