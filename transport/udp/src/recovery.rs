//! Loss detection and probes for unacknowledged packets (RFC 9002).

use std::time::Duration;

use trimaran_net::{CongestionSigns, Instant};

use crate::congestion::Window;
use crate::packet::PacketNumber;
use crate::ranges::RangeSet;
use crate::rtt::Rtt;

mod flight;
mod moved;
mod share;
mod skipped;

use flight::Flight;
pub(crate) use flight::{Content, Contents, Sent};
use share::LossShare;
use skipped::Skipped;

/// A packet is lost when one with a number this much higher has arrived (RFC 9002, section 6.1.1).
pub(crate) const REORDERING: u64 = 3;
/// Losses over this many probe timeouts are persistent congestion (section 7.6.1).
const PERSISTENT: u32 = 3;
/// This many probes are sent if nothing was acknowledged in time, in case one is lost as well (section
/// 6.2.4).
pub(crate) const PROBES: u8 = 2;
/// More packets are hardly lost in a row: if so many go unacknowledged, their acknowledgement was lost.
const ROW: usize = 4;
/// The longest pause between probes: one small packet a second harms no path, and a path that recovers is
/// found at once.
const LONGEST_PAUSE: Duration = Duration::from_secs(1);
/// The result of an acknowledgement or a timeout.
#[derive(Debug, Default)]
pub(crate) struct Verdict {
    pub(crate) arrived: Vec<Content>,
    pub(crate) lost: Contents,
}

/// The kind of probe if nothing was acknowledged in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Probe {
    /// Ask for an acknowledgement.
    Ask,
    /// Retransmit data that may be lost.
    Repeat,
}

/// An acknowledgement of a packet that was never sent.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct NeverSent;

/// The packets of one connection that ask for an acknowledgement; the others are not tracked.
pub(crate) struct Recovery {
    flight: Flight,
    skipped: Skipped,
    largest_acked: Option<PacketNumber>,
    last_sent: Option<Instant>,
    /// When something was acknowledged, or first waited for an acknowledgement.
    progress: Option<Instant>,
    probes: u32,
    /// More than [`ROW`] packets were in flight when the last probes left.
    unanswered: bool,
    loss: LossShare,
    signs: CongestionSigns,
    max_ack_delay: Duration,
    /// A spare buffer for the next acknowledgement.
    spare: Vec<Content>,
    /// The first round-trip measurement of this path.
    sampled: Option<Instant>,
    pub(crate) rtt: Rtt,
    pub(crate) window: Window,
    pub(crate) lost_packets: u64,
    /// Probes since the beginning.
    pub(crate) all_probes: u64,
    /// How many packets acknowledgements have looked up.
    pub(crate) visited: u64,
}

impl Recovery {
    /// A window of `initial` packets of `segment` bytes; the link's receiver buffers `link_window` bytes.
    pub(crate) fn new(segment: usize, initial: u16, max_ack_delay: Duration, link_window: u64) -> Self {
        Self {
            flight: Flight::new(link_window),
            skipped: Skipped::default(),
            largest_acked: None,
            last_sent: None,
            progress: None,
            probes: 0,
            unanswered: false,
            loss: LossShare::new(),
            signs: CongestionSigns::new(),
            max_ack_delay,
            spare: Vec::new(),
            sampled: None,
            rtt: Rtt::default(),
            window: Window::new(segment, initial),
            lost_packets: 0,
            all_probes: 0,
            visited: 0,
        }
    }

    /// The number of the next packet.
    pub(crate) fn next_number(&self) -> PacketNumber {
        self.flight.next_number()
    }

    /// Skips packet numbers from now on, chosen by these 32 random bytes.
    pub(crate) fn leave_numbers_out(&mut self, secret: [u8; 32]) {
        self.skipped = Skipped::new(secret, self.next_number());
    }

    /// The number of packets sent.
    pub(crate) fn sent(&self) -> u64 {
        self.next_number() - self.skipped.count()
    }

    /// The room in the window, bytes.
    pub(crate) fn room(&self) -> usize {
        if self.flight.is_full() { 0 } else { self.window.window().saturating_sub(self.in_flight()) }
    }

    /// The estimated share of lost packets: from the first loss on, one of so many.
    pub(crate) const fn probable_loss(&self) -> f64 {
        self.loss.probable()
    }

    /// Bytes sent, and neither acknowledged nor found lost.
    pub(crate) const fn in_flight(&self) -> usize {
        self.flight.bytes()
    }

    /// Probes since something was acknowledged.
    pub(crate) const fn probes(&self) -> u32 {
        self.probes
    }

    /// Whether acknowledgements seem to be lost, rather than their packets.
    pub(crate) const fn is_unanswered(&self) -> bool {
        self.unanswered
    }

    /// Since when an expected acknowledgement is missing.
    pub(crate) fn unheard_since(&self) -> Option<Instant> {
        self.progress.filter(|_| self.in_flight() > 0)
    }

    /// There is nothing more to send.
    pub(crate) fn on_out_of_data(&mut self) {
        self.signs.on_out_of_data();
    }

    /// The packet with the next number was sent; `eliciting` is `None` if it asks for no acknowledgement.
    /// Returns the contents of a packet that counts as lost because the records are full.
    pub(crate) fn on_sent(&mut self, eliciting: Option<Sent>) -> Contents {
        if let Some(sent) = &eliciting {
            if self.in_flight() == 0 {
                self.progress = Some(sent.at);
            }
            self.last_sent = Some(sent.at);
        }
        let mut lost = self.flight.push(eliciting).map(|sent| sent.contents).unwrap_or_default();
        if self.skipped.leaves_out(self.next_number()) {
            lost.extend(self.flight.push(None).into_iter().flat_map(|sent| sent.contents));
        }
        lost
    }

    pub(crate) fn on_ack(
        &mut self,
        now: Instant,
        numbers: &RangeSet,
        delay: Duration,
    ) -> Result<Verdict, NeverSent> {
        let mut verdict = Verdict { arrived: std::mem::take(&mut self.spare), ..Verdict::default() };
        let Some(last) = numbers.iter().next_back() else { return Ok(verdict) };
        if last.end > self.next_number() || self.skipped.is_in(numbers) {
            return Err(NeverSent);
        }
        let largest = last.end - 1;
        let in_flight = self.in_flight();
        for range in numbers.iter() {
            for number in range.start.max(self.flight.base())..range.end {
                self.visited += 1;
                let Some(sent) = self.flight.forget(number) else { continue };
                if number == largest {
                    let took = now.since(sent.at);
                    self.rtt.sample(took, delay.min(self.max_ack_delay));
                    self.signs.on_round_trip(took);
                    self.sampled.get_or_insert(now);
                }
                self.probes = 0;
                self.unanswered = false;
                self.progress = Some(now);
                if !sent.is_probe() {
                    self.loss.on_arrived();
                    self.signs.on_arrived();
                }
                self.window.on_ack(now, sent.at, sent.bytes, in_flight, self.rtt.smoothed());
                verdict.arrived.extend(sent.contents);
            }
        }
        self.largest_acked = self.largest_acked.max(Some(largest));
        self.detect_losses(now, Some(numbers), &mut verdict);
        self.flight.trim();
        Ok(verdict)
    }

    /// Takes back the buffer of a verdict.
    pub(crate) fn reuse(&mut self, mut arrived: Vec<Content>) {
        arrived.clear();
        if arrived.capacity() > self.spare.capacity() {
            self.spare = arrived;
        }
    }

    /// When [`Recovery::on_timeout`] is due.
    pub(crate) fn timeout(&self) -> Option<Instant> {
        self.loss_time().or_else(|| self.probe_time())
    }

    /// Finds lost packets, or else asks for probes. Probes repeat the oldest packets in flight; but if more
    /// are in flight than are lost in a row, the first ones only ask.
    pub(crate) fn on_timeout(&mut self, now: Instant) -> (Verdict, Option<Probe>) {
        let mut verdict = Verdict::default();
        if self.loss_time().is_some_and(|at| at <= now) {
            self.detect_losses(now, None, &mut verdict);
            self.flight.trim();
            return (verdict, None);
        }
        if self.probe_time().is_none_or(|at| at > now) {
            return (verdict, None);
        }
        self.probes += 1;
        self.all_probes += 1;
        self.last_sent = Some(now);
        self.unanswered = self.flight.iter(None).nth(ROW).is_some();
        if self.unanswered && self.probes == 1 {
            return (verdict, Some(Probe::Ask));
        }
        let oldest = self.flight.iter(None).filter(|sent| !sent.contents.is_empty());
        verdict.lost.extend(oldest.take(PROBES.into()).flat_map(|sent| sent.contents.clone()));
        (verdict, Some(Probe::Repeat))
    }

    fn probe_time(&self) -> Option<Instant> {
        let last = self.last_sent.filter(|_| self.in_flight() > 0)?;
        let once = self.rtt.probe_timeout(self.max_ack_delay);
        Some(last.after((once * 2u32.pow(self.probes.min(10))).min(LONGEST_PAUSE.max(once))))
    }

    fn loss_time(&self) -> Option<Instant> {
        let largest = self.largest_acked?;
        let oldest = self.flight.iter(Some(largest)).next()?;
        Some(oldest.at.after(self.rtt.loss_delay()))
    }

    /// Finds lost packets; `acked` are the numbers of the acknowledgement that shows it, if any.
    fn detect_losses(&mut self, now: Instant, acked: Option<&RangeSet>, verdict: &mut Verdict) {
        let Some(largest) = self.largest_acked else { return };
        let delay = self.rtt.loss_delay();
        let mut last = None;
        // Since when nothing arrived, and the longest such time; packets sent before a round trip was
        // measured do not count.
        let (mut since, mut longest) = (None, Duration::ZERO);
        for number in self.flight.base()..largest {
            self.visited += 1;
            let late = largest - number >= REORDERING;
            let Some(sent) = self.flight.get(number) else {
                since = since.filter(|_| !acked.is_some_and(|acked| acked.contains(number)));
                continue;
            };
            if !late && now.since(sent.at) < delay {
                since = None;
                continue;
            }
            let Some(sent) = self.flight.forget(number) else { continue };
            // The loss of a probe only says that it was too large (RFC 9000, section 14.4).
            if !sent.is_probe() {
                self.lost_packets += 1;
                self.loss.on_lost();
                self.signs.on_lost();
                last = Some(sent.at);
                if self.sampled.is_some_and(|sampled| sampled <= sent.at) {
                    longest = longest.max(sent.at.since(*since.get_or_insert(sent.at)));
                }
            }
            verdict.lost.extend(sent.contents);
        }
        let Some(last) = last else { return };
        if self.signs.are_there() {
            self.window.on_loss(now, last);
        }
        if acked.is_some() && longest > self.rtt.probe_timeout(self.max_ack_delay) * PERSISTENT {
            self.window.on_persistent_congestion();
            self.rtt.forget_minimum();
            self.signs.forget_round_trips();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use smallvec::smallvec;

    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    fn send(recovery: &mut Recovery, ms: u64) -> Content {
        let content = Content::Latest { channel: None, number: recovery.next_number() };
        let contents = smallvec![content.clone()];
        recovery.on_sent(Some(Sent { at: at(ms), bytes: 1000, contents }));
        content
    }

    fn numbers(range: Range<u64>) -> RangeSet {
        let mut set = RangeSet::default();
        set.insert(range);
        set
    }

    fn sender() -> Recovery {
        Recovery::new(1000, 10, Duration::from_millis(1), 4 << 20)
    }

    #[test]
    fn three_packets_later_is_lost_two_is_late() {
        let mut recovery = sender();
        let sent: Vec<_> = (0..5).map(|_| send(&mut recovery, 0)).collect();
        let verdict = recovery.on_ack(at(10), &numbers(2..3), Duration::ZERO).unwrap();
        assert_eq!((verdict.arrived, verdict.lost), (vec![sent[2].clone()], Contents::new()));
        assert_eq!(recovery.visited, 3, "it, and the two before it");
        let verdict = recovery.on_ack(at(10), &numbers(3..4), Duration::ZERO).unwrap();
        assert_eq!(verdict.lost[..], [sent[0].clone()]);
        assert_eq!(recovery.timeout(), Some(at(0).after(Duration::from_micros(11_250))), "9/8 of 10 ms");
        let (verdict, probe) = recovery.on_timeout(at(12));
        assert_eq!((verdict.lost, probe), (smallvec![sent[1].clone()], None));
    }

    #[test]
    fn a_lost_tail_is_probed_with_growing_pauses() {
        let mut recovery = sender();
        let sent = send(&mut recovery, 0);
        // Without a measurement: 100 ms, four times 50 ms, and 1 ms.
        assert_eq!(recovery.timeout(), Some(at(301)));
        let (verdict, probe) = recovery.on_timeout(at(301));
        assert_eq!((verdict.lost, probe), (smallvec![sent], Some(Probe::Repeat)));
        assert_eq!(recovery.timeout(), Some(at(301 + 602)));
        assert_eq!(recovery.lost_packets, 0, "a probe says nothing of loss");
        let mut now = at(301);
        for _ in 0..20 {
            let due = recovery.timeout().unwrap();
            assert!(due.since(now) <= LONGEST_PAUSE);
            now = due;
            recovery.on_timeout(now);
        }
    }

    #[test]
    fn of_many_packets_it_is_asked_first_what_has_arrived() {
        let mut recovery = sender();
        let sent: Vec<_> = (0..=ROW).map(|_| send(&mut recovery, 0)).collect();
        let (verdict, probe) = recovery.on_timeout(at(301));
        assert_eq!((verdict.lost, probe), (Contents::new(), Some(Probe::Ask)));
        assert!(recovery.is_unanswered());
        let (verdict, probe) = recovery.on_timeout(at(301 + 602));
        assert_eq!((&verdict.lost[..], probe), (&sent[..2], Some(Probe::Repeat)), "nothing was answered");
        recovery.on_ack(at(950), &numbers(0..1), Duration::ZERO).unwrap();
        assert!(!recovery.is_unanswered());
        let (_, probe) = recovery.on_timeout(at(9000));
        assert_eq!(
            (probe, recovery.is_unanswered()),
            (Some(Probe::Repeat), false),
            "four can be lost in a row"
        );
    }

    #[test]
    fn what_there_is_no_place_for_is_lost_and_nothing_is_awaited_any_more() {
        let mut recovery = sender();
        let first = send(&mut recovery, 0);
        let mut overflow = Contents::new();
        while overflow.is_empty() {
            assert_eq!(recovery.unheard_since(), Some(at(0)));
            overflow = recovery.on_sent(None);
        }
        assert_eq!((overflow, recovery.unheard_since()), (smallvec![first], None));
        for ms in 0.. {
            recovery.window.on_ack(at(ms), at(ms), 1 << 20, 1 << 30, Duration::from_millis(1));
            if recovery.room() == 0 {
                break;
            }
            send(&mut recovery, ms);
        }
        assert!(recovery.in_flight() < recovery.window.window(), "it is the places that are few");
    }

    #[test]
    fn a_few_losses_without_a_queue_leave_the_window_alone() {
        let mut recovery = sender();
        let lose_one = |recovery: &mut Recovery, ms: u64| {
            let base = recovery.next_number();
            for _ in 0..4 {
                send(recovery, ms);
            }
            recovery.on_ack(at(ms + 10), &numbers(base + 1..base + 4), Duration::ZERO).unwrap();
        };
        lose_one(&mut recovery, 0);
        assert_eq!((recovery.lost_packets, recovery.window.window()), (1, 10_000));
        assert!((recovery.probable_loss() - 1.0 / 64.0).abs() < 1e-3, "as if one of the first 64 were lost");
        let mut ms = 100;
        while !recovery.signs.are_there() {
            assert_eq!(recovery.window.window(), 10_000);
            lose_one(&mut recovery, ms);
            ms += 100;
        }
        assert_eq!(recovery.window.window(), 7_000, "too many for accidents");
    }

    #[test]
    fn a_sender_that_runs_out_of_data_may_lose_more_by_accident() {
        let after_losses = |runs_out: bool| {
            let mut recovery = sender();
            for round in 0..1000 {
                let base = recovery.next_number();
                for _ in 0..4 {
                    send(&mut recovery, 100 * round);
                }
                if runs_out {
                    recovery.on_out_of_data();
                }
                // One of 24 is lost.
                let first = base + u64::from(round % 6 == 0);
                let arrived = numbers(first..base + 4);
                recovery.on_ack(at(100 * round + 10), &arrived, Duration::ZERO).unwrap();
            }
            recovery.window.window()
        };
        assert_eq!(after_losses(true), 10_000);
        assert!(after_losses(false) < 10_000);
    }

    #[test]
    fn what_went_to_an_old_address_is_lost_at_once_and_no_sign_of_congestion() {
        let mut recovery = sender();
        let sent: Vec<_> = (0..=ROW).map(|_| send(&mut recovery, 0)).collect();
        recovery.on_timeout(at(301));
        assert_eq!((recovery.probes(), recovery.is_unanswered()), (1, true));
        assert_eq!(recovery.on_moved()[..], sent);
        assert_eq!((recovery.probes(), recovery.is_unanswered()), (0, false));
        assert_eq!((recovery.in_flight(), recovery.unheard_since(), recovery.timeout()), (0, None, None));
        assert_eq!((recovery.lost_packets, recovery.window.window()), (0, 10_000));
    }

    #[test]
    fn the_largest_buffer_is_used_again_and_is_empty() {
        let mut recovery = sender();
        let sent: Vec<_> = (0..2).map(|_| send(&mut recovery, 0)).collect();
        for capacity in [64, 8] {
            let mut buffer = Vec::with_capacity(capacity);
            buffer.push(sent[1].clone());
            recovery.reuse(buffer);
        }
        let arrived = recovery.on_ack(at(10), &numbers(0..1), Duration::ZERO).unwrap().arrived;
        assert!(arrived.capacity() >= 64 && arrived == sent[..1], "{arrived:?}");
    }

    /// Sends a packet after each `pause`, all of which are lost except those in `arrive`, and then one that
    /// arrives; returns the window.
    fn after_an_outage(sampled: bool, packets: u64, pause: u64, arrive: Range<u64>) -> usize {
        let mut recovery = sender();
        if sampled {
            send(&mut recovery, 0);
            recovery.on_ack(at(10), &numbers(0..1), Duration::ZERO).unwrap();
        }
        let base = recovery.next_number();
        for packet in 0..packets {
            send(&mut recovery, 100 + pause * packet);
        }
        let mut acked = numbers(base + packets..base + packets + 1);
        acked.insert(base + arrive.start..base + arrive.end);
        send(&mut recovery, 100 + pause * packets);
        recovery.on_ack(at(110 + pause * packets), &acked, Duration::ZERO).unwrap();
        recovery.window.window()
    }

    /// A probe timeout is 26 ms here: three of them are the time of four packets, 20 ms apart.
    #[test]
    fn an_outage_of_three_probe_timeouts_leaves_the_smallest_window() {
        assert_eq!(after_an_outage(true, 9, 20, 0..0), 2_000);
        assert!(after_an_outage(true, 4, 20, 0..0) > 2_000, "it was too short");
        assert!(after_an_outage(true, 4, 26, 0..0) > 2_000, "it was just as long");
        assert_eq!(after_an_outage(true, 4, 27, 0..0), 2_000);
        assert!(after_an_outage(true, 9, 20, 4..5) > 2_000, "one between them arrived");
        assert!(after_an_outage(false, 9, 20, 0..0) > 2_000, "nothing was measured before");
    }

    #[test]
    fn a_lost_probe_is_no_sign_of_congestion() {
        let mut recovery = sender();
        let contents: Contents = smallvec![Content::Probe { size: 1452 }];
        recovery.on_sent(Some(Sent { at: at(0), bytes: 1452, contents: contents.clone() }));
        for _ in 0..3 {
            send(&mut recovery, 0);
        }
        let verdict = recovery.on_ack(at(50), &numbers(1..4), Duration::ZERO).unwrap();
        assert_eq!((verdict.lost, recovery.lost_packets), (contents, 0));
        assert_eq!((recovery.probable_loss(), recovery.window.window()), (0.0, 10_000));
    }

    #[test]
    fn who_acknowledges_what_it_did_not_receive_is_found_out() {
        let mut recovery = sender();
        recovery.leave_numbers_out([7; 32]);
        let mut received = RangeSet::default();
        while recovery.skipped.count() < 3 {
            let number = recovery.next_number();
            send(&mut recovery, number);
            received.insert(number..number + 1);
            assert!(recovery.on_ack(at(number + 1), &received, Duration::ZERO).is_ok(), "{number}");
        }
        assert_eq!(received.len(), 3, "two gaps, and one that nobody has seen yet");
        assert_eq!(recovery.sent() + 3, recovery.next_number());
        let number = recovery.next_number();
        send(&mut recovery, number);
        let all = numbers(0..number + 1);
        assert_eq!(recovery.on_ack(at(number + 1), &all, Duration::ZERO).err(), Some(NeverSent));
    }

    #[test]
    fn an_acknowledgement_of_what_was_never_sent_is_refused() {
        let mut recovery = sender();
        send(&mut recovery, 0);
        assert_eq!(recovery.on_ack(at(1), &numbers(0..2), Duration::ZERO).err(), Some(NeverSent));
    }
}
