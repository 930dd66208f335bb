//! The packets in flight, and their contents.

use std::collections::VecDeque;
use std::ops::Range;

use smallvec::SmallVec;
use trimaran_net::Instant;
use trimaran_wire::ChannelNumber;

use crate::chunk::UnitLane;
use crate::packet::{MIN_DATAGRAM, PacketNumber};

/// With so many packets in flight data waits, however small or large the window of the link is. Small windows
/// leave room for small packets; large ones must not fill the memory with them.
const FEWEST: u64 = 1024;
const MOST: u64 = 8 * 1024;

/// The contents of a packet that matter for its loss or arrival.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Content {
    Part {
        lane: UnitLane,
        unit: u64,
        range: Range<u64>,
        ended: bool,
    },
    Latest {
        channel: Option<ChannelNumber>,
        number: u64,
    },
    LastLatest {
        channel: Option<ChannelNumber>,
    },
    MaxData {
        lane: UnitLane,
    },
    StopSending {
        lane: UnitLane,
    },
    GiveUp {
        lane: UnitLane,
        unit: u64,
    },
    /// A repair shard of the block at `offset`: useful while it is fresh, and never retransmitted.
    Repair {
        lane: UnitLane,
        unit: u64,
        offset: u64,
        index: u8,
    },
    /// A probe whether a datagram of that size arrives.
    Probe {
        size: usize,
    },
}

/// The contents of a packet; for most packets without a heap allocation.
pub(crate) type Contents = SmallVec<[Content; 2]>;

/// A packet in flight.
#[derive(Debug)]
pub(crate) struct Sent {
    pub(crate) at: Instant,
    pub(crate) bytes: usize,
    pub(crate) contents: Contents,
}

impl Sent {
    pub(super) fn is_probe(&self) -> bool {
        self.contents.iter().any(|content| matches!(content, Content::Probe { .. }))
    }
}

/// The unacknowledged packets that ask for an acknowledgement; the others are not tracked.
#[derive(Debug)]
pub(super) struct Flight {
    /// Packets from number `base` on; `None` if one was acknowledged, lost, or asked for nothing.
    packets: VecDeque<Option<Sent>>,
    base: PacketNumber,
    bytes: usize,
    /// With so many packets data waits. With twice as many the oldest one counts as lost.
    full: usize,
}

impl Flight {
    /// For a link whose receiver buffers `window` bytes. Twice as many full packets as fill it leave room for
    /// repair, messages and blocks; of values, only the newest waits.
    pub(super) fn new(window: u64) -> Self {
        let full = (window / (MIN_DATAGRAM as u64 / 2)).clamp(FEWEST, MOST) as usize;
        Self { packets: VecDeque::new(), base: 0, bytes: 0, full }
    }

    /// The number of the next packet.
    pub(super) fn next_number(&self) -> PacketNumber {
        self.base + self.packets.len() as u64
    }

    /// The lowest number that may be in flight.
    pub(super) const fn base(&self) -> PacketNumber {
        self.base
    }

    /// The bytes in flight.
    pub(super) const fn bytes(&self) -> usize {
        self.bytes
    }

    /// Whether data must wait: keep-alives and acknowledgements still have room then.
    pub(super) fn is_full(&self) -> bool {
        self.packets.len() >= self.full
    }

    /// The packet with the next number leaves. Returns one that must be forgotten for it.
    pub(super) fn push(&mut self, eliciting: Option<Sent>) -> Option<Sent> {
        self.bytes += eliciting.as_ref().map_or(0, |sent| sent.bytes);
        self.packets.push_back(eliciting);
        let overflow = if self.packets.len() > 2 * self.full { self.forget(self.base) } else { None };
        self.trim();
        overflow
    }

    /// Packets in flight in the order of their numbers, below `end` if it is given.
    pub(super) fn iter(&self, end: Option<PacketNumber>) -> impl Iterator<Item = &Sent> {
        let count = end.map_or(usize::MAX, |end| self.index(end).unwrap_or(0));
        self.packets.iter().take(count).flatten()
    }

    pub(super) fn get(&self, number: PacketNumber) -> Option<&Sent> {
        self.packets.get(self.index(number)?)?.as_ref()
    }

    /// Takes out a packet that is no longer in flight.
    pub(super) fn forget(&mut self, number: PacketNumber) -> Option<Sent> {
        let at = self.index(number)?;
        let sent = self.packets.get_mut(at)?.take()?;
        self.bytes = self.bytes.saturating_sub(sent.bytes);
        Some(sent)
    }

    /// Takes out all packets in flight.
    pub(super) fn forget_all(&mut self) -> impl Iterator<Item = Sent> {
        self.base = self.next_number();
        self.bytes = 0;
        std::mem::take(&mut self.packets).into_iter().flatten()
    }

    /// Frees the entries below the first packet in flight.
    pub(super) fn trim(&mut self) {
        while self.packets.front().is_some_and(Option::is_none) {
            self.packets.pop_front();
            self.base += 1;
        }
    }

    fn index(&self, number: PacketNumber) -> Option<usize> {
        usize::try_from(number.checked_sub(self.base)?).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent() -> Option<Sent> {
        Some(Sent { at: Instant::from_nanos(0), bytes: 1000, contents: Contents::new() })
    }

    #[test]
    fn what_is_never_acknowledged_is_not_remembered_for_ever() {
        for (window, full) in [(0, 1024), (1 << 20, 1747), (4 << 20, 6990), (u64::MAX, 8192)] {
            let mut flight = Flight::new(window);
            flight.push(sent());
            for _ in 1..2 * full {
                assert!(flight.push(None).is_none());
            }
            assert!(flight.push(None).is_some(), "one more than are remembered");
            assert_eq!((flight.packets.len(), flight.bytes()), (0, 0));
            assert_eq!(flight.next_number(), 2 * full + 1);
            for _ in 0..full {
                assert!(!flight.is_full());
                flight.push(sent());
            }
            assert!(flight.is_full());
        }
    }

    #[test]
    fn places_are_freed_from_the_lowest_on() {
        let mut flight = Flight::new(0);
        (0..4).for_each(|_| assert!(flight.push(sent()).is_none()));
        for (number, base) in [(1, 0), (0, 2), (0, 2), (9, 2), (3, 2), (2, 4)] {
            let there = flight.get(number).is_some();
            assert_eq!(flight.forget(number).is_some(), there, "{number}");
            flight.trim();
            assert_eq!(flight.base(), base);
        }
        assert_eq!((flight.next_number(), flight.bytes(), flight.iter(None).count()), (4, 0, 0));
        (0..3).for_each(|_| assert!(flight.push(sent()).is_none()));
        assert_eq!(flight.forget_all().count(), 3);
        assert_eq!((flight.next_number(), flight.base(), flight.bytes()), (7, 7, 0));
    }
}
