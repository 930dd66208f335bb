//! Which packets arrived, and when to say so.

use std::time::Duration;

use trimaran_proto::Instant;

use crate::chunk::{ACK_RANGES, Chunk};
use crate::packet::PacketNumber;
use crate::ranges::RangeSet;
use crate::recovery::REORDERING;

/// So many packets are acknowledged at once, and fewer when they have waited: a frame comes as a burst of packets, and an
/// acknowledgement of each second one (RFC 9000, section 13.2.2) would be a fortieth of its bytes.
const MANY: u32 = 8;

/// The numbers received. It is the replay window as well: below its lowest range everything counts as received.
#[derive(Debug, Default)]
pub(crate) struct Acks {
    numbers: RangeSet,
    floor: PacketNumber,
    largest_at: Option<Instant>,
    /// Packets that ask for an acknowledgement and have not been given one.
    owed: u32,
    due: Option<Instant>,
}

impl Acks {
    pub(crate) fn is_new(&self, number: PacketNumber) -> bool {
        number >= self.floor && !self.numbers.contains(number)
    }

    /// A packet was received, and all of it taken.
    pub(crate) fn on_received(
        &mut self,
        now: Instant,
        number: PacketNumber,
        eliciting: bool,
        max_delay: Duration,
    ) {
        let highest = self.numbers.iter().next_back().map_or(0, |range| range.end);
        if number >= highest {
            self.largest_at = Some(now);
        }
        self.numbers.insert(number..number + 1);
        while self.numbers.len() > ACK_RANGES {
            if let Some(oldest) = self.numbers.pop_front(u64::MAX) {
                self.floor = oldest.end;
            }
        }
        if eliciting {
            self.owed += 1;
            let at_once = self.owed >= MANY || number != highest || self.follows_a_gap(number);
            let wait = if at_once { Duration::ZERO } else { max_delay };
            let at = now.after(wait);
            self.due = Some(self.due.map_or(at, |due| due.min(at)));
        }
    }

    /// Whether a packet below this one is missing, and few came in between: the sender finds out when the third has arrived.
    fn follows_a_gap(&self, number: PacketNumber) -> bool {
        let run = self.numbers.iter().next_back().map_or(0, |range| number + 1 - range.start.min(number));
        self.numbers.len() > 1 && run <= REORDERING
    }

    /// When an acknowledgement must leave.
    pub(crate) const fn due(&self) -> Option<Instant> {
        self.due
    }

    /// The acknowledgement, if one is owed; it counts as given.
    pub(crate) fn take(&mut self, now: Instant) -> Option<Chunk<'static>> {
        if self.owed == 0 {
            return None;
        }
        self.owed = 0;
        self.due = None;
        let delay_us = self.largest_at.map_or(0, |at| now.since(at).as_micros() as u64);
        Some(Chunk::Ack { delay_us, numbers: self.numbers.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DELAY: Duration = Duration::from_millis(1);

    #[test]
    fn every_eighth_packet_and_the_first_three_behind_a_gap_are_acknowledged_at_once() {
        let mut acks = Acks::default();
        let now = Instant::from_nanos(0);
        for number in 0..7 {
            acks.on_received(now, number, true, DELAY);
            assert_eq!(acks.due(), Some(now.after(DELAY)));
        }
        acks.on_received(now, 7, true, DELAY);
        assert_eq!(acks.due(), Some(now));
        assert!(acks.take(now).is_some());
        assert!(acks.take(now).is_none());
        for (number, wait) in [(9, false), (10, false), (11, false), (12, true), (8, false)] {
            acks.on_received(now, number, true, DELAY);
            let due = if wait { now.after(DELAY) } else { now };
            assert_eq!(acks.due(), Some(due), "number 8 is missing, {number} comes");
            assert!(acks.take(now).is_some());
        }
        assert!(!acks.is_new(8) && acks.is_new(13));
    }

    #[test]
    fn what_is_below_the_window_is_a_replay() {
        let mut acks = Acks::default();
        for number in 0..200 {
            acks.on_received(Instant::from_nanos(0), number * 2, true, DELAY);
        }
        assert!(!acks.is_new(1), "too old to tell");
        assert!(acks.is_new(399));
        assert_eq!(acks.numbers.len(), ACK_RANGES);
    }
}
