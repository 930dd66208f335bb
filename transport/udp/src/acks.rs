//! Received packets, and when to acknowledge them.

use std::collections::VecDeque;
use std::time::Duration;

use trimaran_net::Instant;

use crate::chunk::{ACK_RANGES, Asks, Chunk};
use crate::packet::PacketNumber;
use crate::ranges::RangeSet;
use crate::recovery::REORDERING;

/// This many packets are acknowledged immediately, and fewer after a delay. A frame comes as a burst of
/// packets, and an acknowledgement of each second one (RFC 9000, section 13.2.2) would be a fortieth of its
/// bytes. It is also the sender's largest burst.
const MANY: u32 = 10;
/// How many acknowledgements name a number. If all are lost, its packet counts as lost.
const NAMED: usize = 8;

/// The numbers received. It is also the replay window: below its lowest range everything counts as received.
#[derive(Debug, Default)]
pub(crate) struct Acks {
    numbers: RangeSet,
    /// Numbers that are never acknowledged, because not all of their packet could be taken. They are accepted
    /// only once, too.
    refused: RangeSet,
    floor: PacketNumber,
    largest_at: Option<Instant>,
    /// Packets that ask for an acknowledgement and have none yet.
    owed: u32,
    /// Immediate acknowledgements that were asked for.
    asked: u32,
    due: Option<Instant>,
    /// The lowest number since the last acknowledgement, and those before each of the last ones.
    lowest: Option<PacketNumber>,
    named: VecDeque<PacketNumber>,
}

impl Acks {
    pub(crate) fn is_new(&self, number: PacketNumber) -> bool {
        number >= self.floor && !self.numbers.contains(number) && !self.refused.contains(number)
    }

    /// Whether no later packet has been received.
    pub(crate) fn is_newest(&self, number: PacketNumber) -> bool {
        number >= self.end()
    }

    /// One past the highest number received.
    fn end(&self) -> PacketNumber {
        self.numbers.iter().next_back().map_or(0, |range| range.end)
    }

    /// A packet was received but could not be taken completely: its sender must count it as lost.
    pub(crate) fn on_refused(&mut self, number: PacketNumber) {
        self.refused.insert(number..number + 1);
        self.forget_oldest();
    }

    /// A packet was received and taken completely.
    pub(crate) fn on_received(
        &mut self,
        now: Instant,
        number: PacketNumber,
        asks: Asks,
        max_delay: Duration,
    ) {
        let highest = self.end();
        if number >= highest {
            self.largest_at = Some(now);
        }
        self.numbers.insert(number..number + 1);
        self.lowest = Some(self.lowest.map_or(number, |lowest| lowest.min(number)));
        self.forget_oldest();
        if asks > Asks::Nothing {
            self.owed += 1;
            self.asked += u32::from(asks == Asks::AckNow);
            let at_once =
                self.asked > 0 || self.owed >= MANY || number < highest || self.shows_a_loss(highest, number);
            let wait = if at_once { Duration::ZERO } else { max_delay };
            let at = now.after(wait);
            self.due = Some(self.due.map_or(at, |due| due.min(at)));
        }
    }

    /// Moves the window over the oldest ranges, of which there are too many.
    fn forget_oldest(&mut self) {
        for set in [&mut self.numbers, &mut self.refused] {
            while set.len() > ACK_RANGES {
                self.floor = set.pop_front().map_or(self.floor, |oldest| self.floor.max(oldest.end));
            }
        }
        self.refused.remove(&(0..self.floor));
    }

    /// Whether this packet shows the sender that one is lost; the numbers received before ended at `highest`.
    /// Only the third packet behind a gap can (the reordering threshold of draft-ietf-quic-ack-frequency,
    /// section 6.2).
    fn shows_a_loss(&self, highest: PacketNumber, number: PacketNumber) -> bool {
        let (from, to) = (highest.saturating_sub(REORDERING), (number + 1).saturating_sub(REORDERING));
        self.numbers.end_of_run(from) < to
    }

    /// When an acknowledgement must leave.
    pub(crate) const fn due(&self) -> Option<Instant> {
        self.due
    }

    /// The acknowledgement, if one is owed; it is no longer owed then.
    pub(crate) fn take(&mut self, now: Instant) -> Option<Chunk<'static>> {
        if self.owed == 0 {
            return None;
        }
        self.asked = self.asked.saturating_sub(1);
        self.owed = self.asked;
        self.due = Some(now).filter(|_| self.asked > 0);
        let delay_us = self.largest_at.map_or(0, |at| now.since(at).as_micros() as u64);
        self.named.extend(self.lowest.take());
        if self.named.len() > NAMED {
            self.named.pop_front();
        }
        let from = self.named.iter().min().copied().unwrap_or(0);
        Some(Chunk::Ack { delay_us, numbers: self.numbers.reaching_over(from) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DELAY: Duration = Duration::from_millis(1);

    #[test]
    fn every_tenth_packet_and_what_shows_a_loss_are_acknowledged_at_once() {
        let mut acks = Acks::default();
        let now = Instant::from_nanos(0);
        for number in 0..9 {
            acks.on_received(now, number, Asks::Ack, DELAY);
            assert_eq!(acks.due(), Some(now.after(DELAY)));
        }
        acks.on_received(now, 9, Asks::Ack, DELAY);
        assert_eq!(acks.due(), Some(now));
        assert!(acks.take(now).is_some());
        assert!(acks.take(now).is_none());
        for (number, wait) in [(11, true), (12, true), (13, false), (14, true), (10, false)] {
            acks.on_received(now, number, Asks::Ack, DELAY);
            let due = if wait { now.after(DELAY) } else { now };
            assert_eq!(acks.due(), Some(due), "number 10 is missing, {number} comes");
            assert!(acks.take(now).is_some());
        }
        assert!(!acks.is_new(10) && acks.is_new(15));
        for (number, wait) in [(16, true), (17, true), (19, false), (20, true), (21, false)] {
            acks.on_received(now, number, Asks::Ack, DELAY);
            let due = if wait { now.after(DELAY) } else { now };
            assert_eq!(acks.due(), Some(due), "15 and 18 are missing, {number} comes");
            acks.take(now);
        }
    }

    #[test]
    fn each_ping_has_an_acknowledgement_of_its_own() {
        let mut acks = Acks::default();
        let now = Instant::from_nanos(0);
        acks.on_received(now, 0, Asks::Ack, DELAY);
        for number in 1..3 {
            acks.on_received(now, number, Chunk::Ping.asks(), DELAY);
        }
        for _ in 0..2 {
            assert_eq!(acks.due(), Some(now));
            assert!(acks.take(now).is_some());
        }
        assert_eq!((acks.due(), acks.take(now)), (None, None));
    }

    #[test]
    fn the_delay_is_that_of_the_newest_packet() {
        let mut acks = Acks::default();
        let at = |ms| Instant::from_nanos(0).after(ms * DELAY);
        for (ms, number) in [(0, 0), (1, 2), (3, 1)] {
            acks.on_received(at(ms), number, Asks::Ack, DELAY);
        }
        let Some(Chunk::Ack { delay_us, .. }) = acks.take(at(6)) else { panic!("none") };
        assert_eq!(delay_us, 5_000, "number 1 came later, but late");
    }

    #[test]
    fn a_packet_is_named_eight_times() {
        let mut acks = Acks::default();
        let mut named = Vec::new();
        for number in (0..30).step_by(2) {
            acks.on_received(Instant::from_nanos(0), number, Asks::Ack, DELAY);
            let Some(Chunk::Ack { numbers, .. }) = acks.take(Instant::from_nanos(0)) else { panic!("none") };
            named.extend(numbers.iter().flatten());
        }
        for number in (0..16).step_by(2) {
            assert_eq!(named.iter().filter(|other| **other == number).count(), NAMED, "{number}");
        }
        // A late packet is named together with all that came since, so that ranges stay few.
        acks.on_received(Instant::from_nanos(0), 5, Asks::Ack, DELAY);
        let Some(Chunk::Ack { numbers, .. }) = acks.take(Instant::from_nanos(0)) else { panic!("none") };
        assert_eq!(numbers.iter().next(), Some(4..7));
    }

    #[test]
    fn what_is_below_the_window_is_a_replay() {
        let mut acks = Acks::default();
        for number in 0..200 {
            acks.on_received(Instant::from_nanos(0), number * 2, Asks::Ack, DELAY);
        }
        assert!(!acks.is_new(1), "too old to tell");
        assert!(acks.is_new(399));
        assert_eq!(acks.numbers.len(), ACK_RANGES);
    }

    #[test]
    fn what_was_refused_is_not_acknowledged_and_comes_once() {
        let mut acks = Acks::default();
        let now = Instant::from_nanos(0);
        for number in 0..100 {
            assert!(acks.is_new(2 * number));
            acks.on_refused(2 * number);
            assert!(!acks.is_new(2 * number));
        }
        assert_eq!((acks.refused.len(), acks.due(), acks.take(now)), (ACK_RANGES, None, None));
        acks.on_received(now, 300, Asks::Ack, DELAY);
        let Some(Chunk::Ack { numbers, .. }) = acks.take(now) else { panic!("none") };
        assert_eq!((numbers.len(), numbers.iter().next()), (1, Some(300..301)));
    }
}
