//! The live counters of a link.

#[cfg(feature = "udp")]
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

#[cfg(feature = "udp")]
use trimaran_udp::PathStats;
use trimaran_wire::{HEADER_BYTES, Kind};

use super::{LinkStats, Skipped, Tally, Traffic};
use crate::rates::ListenerStats;

/// Reads the counters of a link at any time, from any thread.
#[derive(Debug, Clone)]
pub struct StatsHandle(Arc<Counters>);

impl StatsHandle {
    /// A snapshot. Counters that change meanwhile may differ by one message.
    #[must_use]
    pub fn read(&self) -> LinkStats {
        let Counters { sent, received, floods, skipped, header, .. } = &*self.0;
        LinkStats {
            sent: sent.read(*header),
            received: received.read(*header),
            floods: floods.load(Ordering::Relaxed),
            skipped: skipped.read(),
            #[cfg(feature = "udp")]
            path: self.0.path.get().map(|source| source.path()),
        }
    }

    /// The listener that admitted the peer; `None` at the connecting end.
    #[must_use]
    pub fn listener(&self) -> Option<ListenerStats> {
        self.0.listener.get().cloned()
    }

    /// Sets the listener that admitted the peer.
    pub(crate) fn came_from(&self, listener: ListenerStats) {
        self.0.listener.get_or_init(|| listener);
    }
}

/// A source of packet counts.
#[cfg(feature = "udp")]
pub(crate) trait PathSource: fmt::Debug + Send + Sync {
    /// The counts, or the last ones once the connection has ended.
    fn path(&self) -> PathStats;
}

/// Counters shared by the halves of a link. Its atomics only add up, each by itself: they decide nothing and
/// publish nothing else, so any memory order is correct.
#[derive(Debug)]
pub struct Counters {
    /// Sent by this side.
    pub sent: Direction,
    /// Received by this side.
    pub received: Direction,
    floods: AtomicU64,
    skipped: AtomicSkipped,
    /// The header bytes of a message on this transport.
    header: u64,
    /// The source of packet counts, if the transport has one.
    #[cfg(feature = "udp")]
    path: OnceLock<Box<dyn PathSource>>,
    listener: OnceLock<ListenerStats>,
}

impl Counters {
    /// For a transport whose messages have a header of [`HEADER_BYTES`] each.
    #[must_use]
    pub fn framed() -> Arc<Self> {
        Self::with_header(HEADER_BYTES as u64)
    }

    /// For a transport whose messages have no header.
    #[must_use]
    pub fn unframed() -> Arc<Self> {
        Self::with_header(0)
    }

    fn with_header(header: u64) -> Arc<Self> {
        let (sent, received) = (Direction::default(), Direction::default());
        Arc::new(Self {
            sent,
            received,
            floods: AtomicU64::new(0),
            skipped: AtomicSkipped::default(),
            header,
            #[cfg(feature = "udp")]
            path: OnceLock::new(),
            listener: OnceLock::new(),
        })
    }

    /// Counts that the peer exceeded its message rate.
    pub(crate) fn flooded(&self) {
        self.floods.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts frames that were not returned to their reader.
    pub(crate) fn skip(&self, Skipped { replaced, expired, incomplete }: Skipped) {
        self.skipped.replaced.fetch_add(replaced, Ordering::Relaxed);
        self.skipped.expired.fetch_add(expired, Ordering::Relaxed);
        self.skipped.incomplete.fetch_add(incomplete, Ordering::Relaxed);
    }

    /// Adds the counts of `other`.
    pub(crate) fn absorb(&self, other: &Self) {
        self.sent.absorb(&other.sent);
        self.received.absorb(&other.received);
    }

    /// Uses `source` for packet counts. The first call counts.
    #[cfg(feature = "udp")]
    pub(crate) fn watch(&self, source: impl PathSource + 'static) {
        self.path.get_or_init(|| Box::new(source));
    }

    pub(crate) fn handle(self: &Arc<Self>) -> StatsHandle {
        StatsHandle(Arc::clone(self))
    }
}

#[derive(Debug, Default)]
struct AtomicSkipped {
    replaced: AtomicU64,
    expired: AtomicU64,
    incomplete: AtomicU64,
}

impl AtomicSkipped {
    fn read(&self) -> Skipped {
        let Self { replaced, expired, incomplete } = self;
        let [replaced, expired, incomplete] =
            [replaced, expired, incomplete].map(|count| count.load(Ordering::Relaxed));
        Skipped { replaced, expired, incomplete }
    }
}

/// Counters of one direction. Relaxed, because they only add up.
#[derive(Debug, Default)]
pub struct Direction {
    latest: AtomicTally,
    begin: AtomicTally,
    batches: AtomicTally,
    items: AtomicU64,
    end: AtomicTally,
    messages: AtomicTally,
    bulk: AtomicTally,
    control: AtomicTally,
}

#[derive(Debug, Default)]
struct AtomicTally {
    messages: AtomicU64,
    bytes: AtomicU64,
}

impl AtomicTally {
    fn absorb(&self, other: &Self) {
        let Tally { messages, bytes } = other.read();
        self.messages.fetch_add(messages, Ordering::Relaxed);
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    fn read(&self) -> Tally {
        Tally { messages: self.messages.load(Ordering::Relaxed), bytes: self.bytes.load(Ordering::Relaxed) }
    }
}

impl Direction {
    /// Counts one message of `bytes` bytes of payload.
    pub fn count(&self, kind: Kind, bytes: usize) {
        let tally = match kind {
            Kind::Latest | Kind::Numbered => &self.latest,
            Kind::Begin => &self.begin,
            Kind::Batch | Kind::Coded => &self.batches,
            Kind::End => &self.end,
            Kind::Message => &self.messages,
            Kind::Block => &self.bulk,
            Kind::Hello
            | Kind::ChannelsHello
            | Kind::Accept
            | Kind::VersionedAccept
            | Kind::Refuse
            | Kind::Close
            | Kind::KeepAlive => &self.control,
        };
        tally.messages.fetch_add(1, Ordering::Relaxed);
        tally.bytes.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Counts items, plain or coded.
    pub(crate) fn count_items(&self, items: usize) {
        self.items.fetch_add(items as u64, Ordering::Relaxed);
    }

    /// The payload bytes of frames: beginnings, batches and ends.
    pub(crate) fn frame_bytes(&self) -> u64 {
        [&self.begin, &self.batches, &self.end].into_iter().map(|tally| tally.read().bytes).sum()
    }

    fn absorb(&self, other: &Self) {
        let Self { latest, begin, batches, items, end, messages, bulk, control } = self;
        items.fetch_add(other.items.load(Ordering::Relaxed), Ordering::Relaxed);
        latest.absorb(&other.latest);
        begin.absorb(&other.begin);
        batches.absorb(&other.batches);
        end.absorb(&other.end);
        messages.absorb(&other.messages);
        bulk.absorb(&other.bulk);
        control.absorb(&other.control);
    }

    fn read(&self, header: u64) -> Traffic {
        let mut traffic = Traffic {
            latest: self.latest.read(),
            begin: self.begin.read(),
            batches: self.batches.read(),
            items: self.items.load(Ordering::Relaxed),
            end: self.end.read(),
            messages: self.messages.read(),
            bulk: self.bulk.read(),
            control: self.control.read(),
            header_bytes: 0,
        };
        let messages = traffic.latest.messages
            + traffic.begin.messages
            + traffic.batches.messages
            + traffic.end.messages
            + traffic.messages.messages
            + traffic.bulk.messages
            + traffic.control.messages;
        traffic.header_bytes = messages * header;
        traffic
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_told_apart_by_kind_and_direction() {
        let counters = Counters::framed();
        counters.sent.count(Kind::Batch, 40);
        counters.sent.count(Kind::Coded, 8);
        counters.sent.count_items(13);
        counters.received.count(Kind::Latest, 72);
        counters.received.count(Kind::Close, 1);
        let early = counters.handle().read();
        assert_eq!(early.sent.batches, Tally { messages: 2, bytes: 48 });
        assert_eq!(early.sent.items, 13);
        assert_eq!(early.sent.total_bytes(), 48 + 2 * 4);
        assert_eq!(early.received.latest, Tally { messages: 1, bytes: 72 });
        assert_eq!(early.received.control, Tally { messages: 1, bytes: 1 });

        counters.sent.count(Kind::End, 16);
        let later = counters.handle().read() - early;
        assert_eq!(later.sent.end, Tally { messages: 1, bytes: 16 });
        assert_eq!((later.sent.header_bytes, later.sent.total_bytes()), (4, 20));
        assert_eq!(later.received, Traffic::default());
    }

    #[test]
    fn one_process_has_no_headers() {
        let counters = Counters::unframed();
        counters.sent.count(Kind::Begin, 76);
        assert_eq!(counters.handle().read().sent.total_bytes(), 76);
    }
}
