//! Packets sent and not acknowledged, and which of them are lost (RACK, RFC 8985).

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;
use trimaran_net::Instant;

use super::segment::Range;

/// This many selective acknowledgements mean a loss, unless the path is known to reorder packets.
const DUPLICATES: u32 = 3;

/// A packet that is not acknowledged yet.
#[derive(Debug)]
pub(super) struct Sent {
    pub(super) seq: u64,
    pub(super) data: Bytes,
    pub(super) fin: bool,
    /// When it was sent last.
    pub(super) at: Instant,
    /// It was sent more than once.
    pub(super) again: bool,
    /// A retransmission of it is still in flight.
    repeated: bool,
    sacked: bool,
    lost: bool,
}

impl Sent {
    pub(super) fn end(&self) -> u64 {
        self.seq + self.data.len() as u64 + u64::from(self.fin)
    }

    /// Marks it as lost, with its retransmission, and counts that.
    fn lose(&mut self, lost: &mut u32, repeated: &mut u32) {
        *repeated -= u32::from(std::mem::take(&mut self.repeated));
        *lost += u32::from(!std::mem::replace(&mut self.lost, true));
    }
}

/// The effects of an acknowledgement.
#[derive(Debug, Default)]
pub(super) struct News {
    /// Packets newly known to have arrived.
    pub(super) delivered: u32,
    /// Of these, those acknowledged in order.
    pub(super) acknowledged: u32,
    /// The round trip of the oldest packet acknowledged that was sent only once, and of the newest.
    pub(super) rtt: Option<Duration>,
    pub(super) latest_rtt: Option<Duration>,
    /// Some arrived out of order.
    pub(super) sacked: bool,
}

/// The packets that are not acknowledged, in order.
#[derive(Debug, Default)]
pub(super) struct Scoreboard {
    sent: VecDeque<Sent>,
    sacked: u32,
    lost: u32,
    repeated: u32,
    /// The end of the data known to have arrived.
    highest: u64,
    /// The packet sent last of those that have arrived: when it was sent, its end, and its round trip.
    newest: Option<(Instant, u64, Duration)>,
    /// The path has reordered packets.
    reorders: bool,
    /// How many quarters of a round trip, beside the first, a packet may be late.
    more_quarters: u32,
}

impl Scoreboard {
    pub(super) fn packets(&self) -> u32 {
        self.sent.len() as u32
    }

    pub(super) fn is_empty(&self) -> bool {
        self.sent.is_empty()
    }

    pub(super) const fn has_lost(&self) -> bool {
        self.lost > 0
    }

    /// The number of retransmissions in flight.
    pub(super) const fn repeated(&self) -> u32 {
        self.repeated
    }

    /// The number of packets in flight.
    pub(super) fn in_flight(&self) -> u32 {
        (self.packets() + self.repeated).saturating_sub(self.sacked + self.lost)
    }

    pub(super) fn oldest(&self) -> Option<&Sent> {
        self.sent.front()
    }

    pub(super) fn push(&mut self, now: Instant, seq: u64, data: Bytes, fin: bool) {
        let (again, repeated, sacked, lost) = (false, false, false, false);
        self.sent.push_back(Sent { seq, data, fin, at: now, again, repeated, sacked, lost });
    }

    /// The next lost packet that was not retransmitted since; it now counts as retransmitted.
    pub(super) fn repeat_lost(&mut self, now: Instant) -> Option<&Sent> {
        if self.lost <= self.repeated {
            return None;
        }
        let packet = self.sent.iter_mut().find(|packet| packet.lost && !packet.repeated)?;
        self.repeated += 1;
        (packet.at, packet.again, packet.repeated) = (now, true, true);
        Some(packet)
    }

    /// The last packet, to be sent once more as a probe.
    pub(super) fn repeat_last(&mut self, now: Instant) -> Option<&Sent> {
        let packet = self.sent.iter_mut().rev().find(|packet| !packet.sacked)?;
        if !packet.repeated {
            packet.repeated = true;
            self.repeated += 1;
        }
        (packet.at, packet.again) = (now, true);
        Some(packet)
    }

    /// An acknowledgement came: everything before `ack` and in the ranges has arrived.
    pub(super) fn acknowledge(
        &mut self,
        now: Instant,
        ack: u64,
        sacks: &[Range],
        min_rtt: Option<Duration>,
    ) -> News {
        let mut news = News::default();
        let known = self.highest;
        while let Some(packet) = self.sent.front().filter(|packet| packet.end() <= ack) {
            let rtt = now.since(packet.at);
            if !packet.again {
                news.rtt = news.rtt.or(Some(rtt));
                news.latest_rtt = Some(rtt);
            }
            if packet.sacked {
                self.sacked -= 1;
            } else {
                news.delivered += 1;
                self.reorders |= !packet.again && packet.end() < known;
                Self::note_newest(&mut self.newest, packet, rtt, min_rtt);
            }
            news.acknowledged += 1;
            self.lost -= u32::from(packet.lost);
            self.repeated -= u32::from(packet.repeated);
            self.sent.pop_front();
        }
        self.highest = self.highest.max(ack);
        for range in sacks {
            let first = self.sent.partition_point(|packet| packet.seq < range.from);
            for packet in self.sent.range_mut(first..).take_while(|packet| packet.end() <= range.to) {
                if packet.sacked {
                    continue;
                }
                packet.sacked = true;
                self.sacked += 1;
                news.delivered += 1;
                news.sacked = true;
                let rtt = now.since(packet.at);
                if !packet.again {
                    news.latest_rtt = Some(rtt);
                    self.reorders |= packet.end() < known;
                }
                self.lost -= u32::from(std::mem::take(&mut packet.lost));
                self.repeated -= u32::from(std::mem::take(&mut packet.repeated));
                Self::note_newest(&mut self.newest, packet, rtt, min_rtt);
                self.highest = self.highest.max(packet.end());
            }
        }
        news
    }

    fn note_newest(
        newest: &mut Option<(Instant, u64, Duration)>,
        packet: &Sent,
        rtt: Duration,
        min_rtt: Option<Duration>,
    ) {
        // An acknowledgement too soon after a retransmission is for the original.
        if packet.again && min_rtt.is_some_and(|min| rtt < min) {
            return;
        }
        if newest.is_none_or(|(at, end, _)| (packet.at, packet.end()) > (at, end)) {
            *newest = Some((packet.at, packet.end(), rtt));
        }
    }

    /// The peer got a duplicate: the packet was only late.
    pub(super) fn be_more_patient(&mut self) {
        self.more_quarters = (self.more_quarters + 1).min(254);
        self.reorders = true;
    }

    /// Marks packets as lost that were sent long enough before one that arrived. Returns the time until more
    /// are lost, if nothing else comes.
    pub(super) fn find_lost(
        &mut self,
        now: Instant,
        recovering: bool,
        min_rtt: Option<Duration>,
        smoothed: Option<Duration>,
    ) -> Option<Duration> {
        let (newest_at, newest_end, rtt) = self.newest?;
        let certain = !self.reorders && (recovering || self.sacked >= DUPLICATES);
        let window = if certain {
            Duration::ZERO
        } else {
            (min_rtt.unwrap_or(rtt) / 4).saturating_mul(1 + self.more_quarters).min(smoothed.unwrap_or(rtt))
        };
        let mut wait = None;
        for packet in &mut self.sent {
            if packet.sacked || (packet.lost && !packet.repeated) {
                continue;
            }
            if (packet.at, packet.end()) >= (newest_at, newest_end) {
                if packet.at > newest_at && !packet.again {
                    break; // all behind it were sent later still, but for repetitions, which come first
                }
                continue;
            }
            let left = (rtt + window).saturating_sub(now.since(packet.at));
            if left.is_zero() {
                packet.lose(&mut self.lost, &mut self.repeated);
            } else {
                wait = wait.max(Some(left));
            }
        }
        wait
    }

    /// The timeout expired: the oldest packet is lost, and all that were not sent within a round trip.
    pub(super) fn give_up(&mut self, now: Instant) {
        let recent = self.newest.map(|(_, _, rtt)| rtt);
        for (index, packet) in self.sent.iter_mut().enumerate() {
            if packet.sacked || (index > 0 && recent.is_some_and(|rtt| now.since(packet.at) < rtt)) {
                continue;
            }
            packet.lose(&mut self.lost, &mut self.repeated);
        }
    }

    /// Takes all loss marks back.
    pub(super) fn nothing_is_lost(&mut self) {
        for packet in &mut self.sent {
            packet.lost = false;
        }
        self.lost = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn at(millis: u64) -> Instant {
        Instant::from_nanos(millis * 1_000_000)
    }

    const fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    const fn range(from: u64, to: u64) -> Range {
        Range { from: from * 100, to: to * 100 }
    }

    /// Packets of 100 bytes, one each millisecond.
    fn sent(count: u64) -> Scoreboard {
        let mut scoreboard = Scoreboard::default();
        for n in 0..count {
            scoreboard.push(at(n), n * 100, Bytes::from_static(&[0; 100]), false);
        }
        scoreboard
    }

    #[test]
    fn acknowledgements_give_round_trips_and_room() {
        let mut scoreboard = sent(4);
        let news = scoreboard.acknowledge(at(20), 200, &[], None);
        assert_eq!((news.delivered, news.acknowledged), (2, 2));
        assert_eq!((news.rtt, news.latest_rtt), (Some(ms(20)), Some(ms(19))));
        assert_eq!((scoreboard.packets(), scoreboard.in_flight()), (2, 2));
    }

    #[test]
    fn three_packets_ahead_make_one_lost_and_fewer_wait_a_quarter_round_trip() {
        let mut scoreboard = sent(6);
        scoreboard.acknowledge(at(20), 100, &[], None);
        scoreboard.acknowledge(at(22), 100, &[range(2, 3)], Some(ms(20)));
        // Packet 2 took 20 ms: packet 1 has until 20 + 20/4 ms after it was sent.
        assert_eq!(scoreboard.find_lost(at(22), false, Some(ms(20)), Some(ms(20))), Some(ms(4)));
        assert!(!scoreboard.has_lost());
        scoreboard.acknowledge(at(24), 100, &[range(2, 5)], Some(ms(20)));
        scoreboard.find_lost(at(24), false, Some(ms(20)), Some(ms(20)));
        assert!(scoreboard.has_lost());
        assert_eq!(scoreboard.in_flight(), 1, "only the last");
        assert_eq!(scoreboard.repeat_lost(at(24)).unwrap().seq, 100);
        assert!(scoreboard.repeat_lost(at(24)).is_none());
        assert_eq!(scoreboard.in_flight(), 2);
    }

    #[test]
    fn a_repetition_that_is_lost_too_is_found_by_what_was_sent_after_it() {
        let mut scoreboard = sent(5);
        scoreboard.acknowledge(at(20), 0, &[range(1, 4)], None);
        scoreboard.find_lost(at(20), false, Some(ms(20)), Some(ms(20)));
        assert_eq!(scoreboard.repeat_lost(at(21)).unwrap().seq, 0);
        scoreboard.push(at(22), 500, Bytes::from_static(&[0; 100]), false);
        scoreboard.acknowledge(at(42), 0, &[range(1, 6)], Some(ms(19)));
        scoreboard.find_lost(at(42), true, Some(ms(20)), Some(ms(20)));
        assert_eq!(scoreboard.repeat_lost(at(42)).unwrap().seq, 0);
    }

    #[test]
    fn where_packets_overtake_each_other_patience_is_kept() {
        let mut scoreboard = sent(6);
        scoreboard.acknowledge(at(20), 0, &[range(1, 2)], None);
        // Packet 0 arrives after packet 1 without a retransmission.
        scoreboard.acknowledge(at(21), 200, &[], None);
        scoreboard.acknowledge(at(25), 200, &[range(3, 6)], Some(ms(20)));
        assert_eq!(scoreboard.find_lost(at(25), false, Some(ms(20)), Some(ms(20))), Some(ms(2)));
        assert!(!scoreboard.has_lost(), "three ahead are no proof any more");
    }

    #[test]
    fn a_timeout_spares_what_was_just_sent() {
        let mut scoreboard = sent(3);
        scoreboard.acknowledge(at(20), 100, &[], None);
        scoreboard.push(at(215), 300, Bytes::from_static(&[0; 100]), false);
        scoreboard.give_up(at(221));
        assert_eq!((scoreboard.lost, scoreboard.in_flight()), (2, 1));
    }
}
