//! Which packets arrived, and when to say so.

use std::time::Duration;

use trimaran_proto::Instant;

use crate::chunk::{ACK_RANGES, Chunk};
use crate::packet::PacketNumber;
use crate::ranges::RangeSet;

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
            // Every second packet at once, and any that shows a gap or closes one (RFC 9000, section 13.2.1).
            let wait = if self.owed >= 2 || number != highest { Duration::ZERO } else { max_delay };
            let at = now.after(wait);
            self.due = Some(self.due.map_or(at, |due| due.min(at)));
        }
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
    fn every_second_packet_and_every_gap_is_acknowledged_at_once() {
        let mut acks = Acks::default();
        let now = Instant::from_nanos(0);
        acks.on_received(now, 0, true, DELAY);
        assert_eq!(acks.due(), Some(now.after(DELAY)));
        acks.on_received(now, 1, true, DELAY);
        assert_eq!(acks.due(), Some(now));
        assert!(acks.take(now).is_some());
        assert!(acks.take(now).is_none());
        acks.on_received(now, 3, true, DELAY);
        assert_eq!(acks.due(), Some(now), "number 2 is missing");
        assert!(acks.is_new(2) && !acks.is_new(3));
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
