//! When the receiver acknowledges: Linux's quick and delayed acknowledgements.

use std::time::Duration;

use trimaran_net::Instant;

/// Linux's `TCP_DELACK_MIN` and `TCP_ATO_MIN`, and the most that an acknowledgement is delayed.
const DELAY_MIN: Duration = Duration::from_millis(40);
const DELAY_MAX: Duration = Duration::from_millis(200);
/// The most immediate acknowledgements in a row.
const QUICK_MAX: u32 = 16;

#[derive(Debug, Default)]
pub(super) struct DelayedAck {
    /// The estimated pace of the sender; none before the first data.
    pace: Option<Duration>,
    last_data: Instant,
    /// The number of acknowledgements still to be sent immediately.
    quick: u32,
    /// Both sides talk in turns, so an acknowledgement can be piggybacked on the answer.
    dialogue: bool,
    /// Until when an acknowledgement may wait.
    due: Option<Instant>,
    /// How many messages, up to two, have ended in unacknowledged data.
    pushed: u8,
    /// The largest segment seen.
    pub(super) segment: u32,
}

impl DelayedAck {
    pub(super) fn new() -> Self {
        Self { segment: 536, ..Self::default() }
    }

    pub(super) const fn due(&self) -> Option<Instant> {
        self.due
    }

    /// Data came. `window` is the advertised window; `rto` this side's timeout.
    pub(super) fn received(&mut self, now: Instant, bytes: u32, push: bool, window: u32, rto: Duration) {
        if bytes >= self.segment {
            self.segment = bytes;
        }
        if push || bytes < self.segment {
            self.pushed = (self.pushed + 1).min(2);
        }
        let gap = now.since(self.last_data);
        match self.pace {
            None => {
                self.be_quick(window);
                self.pace = Some(DELAY_MIN);
            }
            Some(pace) if gap <= DELAY_MIN / 2 => self.pace = Some(pace / 2 + DELAY_MIN / 2),
            Some(pace) if gap < pace => self.pace = Some((pace / 2 + gap).min(rto)),
            // The sender starts over and needs acknowledgements.
            Some(_) if gap > rto => self.be_quick(window),
            Some(_) => {}
        }
        self.last_data = now;
    }

    /// Acknowledges immediately for a while, so that a sender in slow start can grow.
    fn be_quick(&mut self, window: u32) {
        let packets = window / (2 * self.segment.max(1));
        self.quick = self.quick.max(packets.clamp(2, QUICK_MAX));
    }

    /// Data came out of order or twice: acknowledges immediately for a while.
    pub(super) fn out_of_order(&mut self, window: u32) {
        self.dialogue = false;
        self.be_quick(window);
    }

    /// Data was sent: soon after received data, that makes a dialogue.
    pub(super) fn answered(&mut self, now: Instant) {
        if self.pace.is_some_and(|pace| now.since(self.last_data) < pace) {
            self.dialogue = true;
        }
    }

    /// Whether to acknowledge now, with so many bytes unacknowledged. If not, notes the time.
    pub(super) fn wants_now(
        &mut self,
        now: Instant,
        unacknowledged: u64,
        smoothed: Option<Duration>,
    ) -> bool {
        let two = unacknowledged > u64::from(self.segment);
        if two || (self.quick > 0 && !self.dialogue) {
            return true;
        }
        let mut delay = self.pace.unwrap_or(DELAY_MIN);
        if delay > DELAY_MIN {
            let most = if self.dialogue || self.pushed > 0 { DELAY_MAX } else { Duration::from_millis(500) };
            let most = smoothed.map_or(most, |rtt| rtt.max(DELAY_MIN).min(most));
            delay = delay.min(most);
        }
        let due = now.after(delay.min(DELAY_MAX));
        self.due = Some(self.due.map_or(due, |earlier| earlier.min(due)));
        false
    }

    /// Whether to acknowledge now that the program has read everything.
    pub(super) const fn wants_after_reading(&self, unacknowledged: u64) -> bool {
        self.due.is_some()
            && (unacknowledged > self.segment as u64
                || self.pushed > 1
                || (self.pushed > 0 && !self.dialogue))
    }

    /// The delay ended without an answer to carry the acknowledgement: no dialogue.
    pub(super) fn expired(&mut self) {
        self.due = None;
        if self.dialogue {
            self.dialogue = false;
            self.pace = Some(DELAY_MIN);
        } else {
            self.pace = self.pace.map(|pace| (pace * 2).min(DELAY_MAX));
        }
    }

    /// An acknowledgement has left, alone or with data.
    pub(super) const fn sent(&mut self) {
        self.quick = self.quick.saturating_sub(1);
        self.due = None;
        self.pushed = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn at(millis: u64) -> Instant {
        Instant::from_nanos(millis * 1_000_000)
    }

    const RTO: Duration = Duration::from_millis(205);
    const RTT: Option<Duration> = Some(Duration::from_millis(5));

    /// Uses up the quick acknowledgements that a connection begins with.
    fn settled() -> DelayedAck {
        let mut ack = DelayedAck::new();
        for _ in 0..20 {
            ack.received(at(0), 1448, false, 64_000, RTO);
            ack.sent();
        }
        ack
    }

    #[test]
    fn the_first_packets_are_acknowledged_at_once() {
        let mut ack = DelayedAck::new();
        let mut quick = 0;
        loop {
            ack.received(at(quick), 1448, false, 64_000, RTO);
            if !ack.wants_now(at(quick), 1448, RTT) {
                break;
            }
            ack.sent();
            quick += 1;
        }
        assert_eq!(quick, u64::from(QUICK_MAX));
    }

    #[test]
    fn every_second_full_packet_is_and_a_single_one_within_40_ms() {
        let mut ack = settled();
        ack.received(at(100), 1448, false, 64_000, RTO);
        assert!(!ack.wants_now(at(100), 1448, RTT));
        assert!(ack.due().is_some_and(|due| due <= at(140) && due > at(110)), "{:?}", ack.due());
        ack.received(at(101), 1448, false, 64_000, RTO);
        assert!(ack.wants_now(at(101), 2896, RTT));
    }

    #[test]
    fn a_message_that_the_program_has_read_is_acknowledged_unless_it_answers() {
        let mut ack = settled();
        ack.received(at(100), 76, true, 64_000, RTO);
        assert!(!ack.wants_now(at(100), 76, RTT));
        assert!(ack.wants_after_reading(76));
        ack.answered(at(101));
        assert!(!ack.wants_after_reading(76));
    }

    #[test]
    fn disorder_and_long_pauses_make_it_quick_again() {
        let mut ack = settled();
        ack.out_of_order(64_000);
        assert!(ack.wants_now(at(101), 0, RTT));
        let mut ack = settled();
        ack.received(at(900), 1448, false, 64_000, RTO);
        assert!(ack.wants_now(at(900), 1448, RTT));
    }
}
