//! One direction of a link at work: packets go in, and it tells when they come out.

use std::collections::VecDeque;
use std::time::Duration;

use trimaran_net::Instant;

use super::jitter::Variation;
use super::loss::LossProcess;
use super::parcel::{Action, Ecn, Parcel};
use super::queue::{Queue, Verdict};
use super::{Conditions, LinkModel, LinkTally, Outage, Rate};
use crate::random::Random;

/// One direction of a link. Sans-IO: its owner keeps the time, and carries out the actions of
/// [`Pipe::next_action`].
///
/// A packet waits in the queue, is sent at the link's rate, and then propagates. Impairments (loss,
/// corruption, duplication, reordering) apply after sending, so a lost packet has taken its time on the line.
#[derive(Debug)]
pub struct Pipe<P> {
    model: LinkModel,
    queue: Queue<Parcel<P>>,
    actions: VecDeque<Action<P>>,
    tally: LinkTally,
    /// A wake-up is scheduled for when the line is free.
    waking: bool,
    busy_until: Instant,
    /// The rounding error of the sending times since the line was last idle: bits times 10^9, less than the
    /// rate.
    residue: u64,
    /// The latest arrival so far. No packet overtakes it unless the link reorders.
    last_arrival: Instant,
    loss_process: LossProcess,
    variation: Variation,
    random: Random,
}

impl<P: Clone> Pipe<P> {
    /// An idle link. Each `seed` gives an independent random stream.
    #[must_use]
    pub fn new(model: LinkModel, seed: u64) -> Self {
        let start = Instant::from_nanos(0);
        Self {
            queue: Queue::new(model.queue),
            model,
            actions: VecDeque::new(),
            tally: LinkTally::default(),
            waking: false,
            busy_until: start,
            residue: 0,
            last_arrival: start,
            loss_process: LossProcess::new(Random::stream(seed, 1)),
            variation: Variation::new(Random::stream(seed, 2)),
            random: Random::stream(seed, 3),
        }
    }

    /// The tally of all packets so far.
    #[must_use]
    pub const fn tally(&self) -> &LinkTally {
        &self.tally
    }

    /// The link's model.
    #[must_use]
    pub const fn model(&self) -> &LinkModel {
        &self.model
    }

    /// Changes the link from now on. Packets on the line or in flight keep their times, and waiting ones are
    /// sent under the new model. Random streams go on. The framing stays as it is, because it says how many
    /// bytes the packets under way have.
    pub fn set_model(&mut self, model: LinkModel) {
        self.queue.set_model(model.queue);
        self.model = LinkModel { framing: self.model.framing, ..model };
    }

    /// The next action to carry out.
    pub fn next_action(&mut self) -> Option<Action<P>> {
        self.actions.pop_front()
    }

    /// Offers a packet to the link.
    pub fn offer(&mut self, now: Instant, parcel: Parcel<P>) {
        let bytes = self.frame_bytes(&parcel);
        self.tally.offered += bytes;
        if parcel.ip_bytes > self.model.mtu {
            self.tally.dropped.mtu += bytes;
            self.left(now, &parcel);
            return;
        }
        match self.queue.push(now, bytes, parcel) {
            Ok(()) => self.tally.queued += bytes,
            Err(parcel) => {
                self.tally.dropped.queue += bytes;
                self.left(now, &parcel);
                return;
            }
        }
        if !self.waking {
            self.send_next(now);
        }
    }

    /// The line is free again: the time of [`Action::Wake`] has come.
    pub fn free(&mut self, now: Instant) {
        self.waking = false;
        self.send_next(now);
    }

    /// A packet has come out and goes to its receiver.
    pub fn arrived(&mut self, parcel: &Parcel<P>) {
        let bytes = self.frame_bytes(parcel);
        self.tally.flying -= bytes;
        self.tally.delivered += bytes;
    }

    /// A packet is dropped in place of an offer, because of a partition.
    pub(crate) fn refuse(&mut self, now: Instant, parcel: &Parcel<P>) {
        let bytes = self.frame_bytes(parcel);
        self.tally.offered += bytes;
        self.tally.dropped.partitioned += bytes;
        self.left(now, parcel);
    }

    /// A packet has come out and is dropped for this cause.
    pub(crate) fn drop_arrived(&mut self, parcel: &Parcel<P>, cause: Outage) {
        let bytes = self.frame_bytes(parcel);
        self.tally.flying -= bytes;
        match cause {
            Outage::Partition => self.tally.dropped.partitioned += bytes,
            Outage::Down => self.tally.dropped.down += bytes,
        }
    }

    /// The host before the link has crashed, and with it the queue.
    pub(crate) fn drop_queue(&mut self) {
        let Self { queue, tally, model, .. } = self;
        for parcel in queue.drain() {
            let bytes = model.framing.frame_bytes(parcel.ip_bytes);
            tally.queued -= bytes;
            tally.dropped.down += bytes;
        }
    }

    /// Sends from the queue while the line is free, and schedules the next wake-up.
    fn send_next(&mut self, now: Instant) {
        let mtu = self.model.mtu;
        loop {
            if self.queue.is_empty() {
                return;
            }
            if now < self.busy_until {
                self.waking = true;
                self.actions.push_back(Action::Wake(self.busy_until));
                return;
            }
            match self.queue.next(now, mtu, |parcel| parcel.ecn.is_markable()) {
                None => return,
                Some(Verdict::Send(parcel)) => self.send(now, parcel),
                Some(Verdict::Mark(parcel)) => {
                    let bytes = self.frame_bytes(&parcel);
                    self.tally.marked += bytes;
                    self.send(now, Parcel { ecn: Ecn::Experienced, ..parcel });
                }
                Some(Verdict::Drop(parcel)) => {
                    let bytes = self.frame_bytes(&parcel);
                    self.tally.queued -= bytes;
                    self.tally.dropped.managed += bytes;
                    self.left(now, &parcel);
                }
            }
        }
    }

    fn send(&mut self, now: Instant, parcel: Parcel<P>) {
        let conditions = *self.model.conditions_at(now);
        let bytes = self.frame_bytes(&parcel);
        self.tally.queued -= bytes;
        let sent = match conditions.rate {
            Some(rate) => {
                now.after(self.sending_time(now, rate, self.model.framing.line_bytes(parcel.ip_bytes)))
            }
            None => now,
        };
        self.busy_until = sent;
        self.left(sent, &parcel);
        if self.loss_process.is_lost(&conditions.loss) {
            self.tally.dropped.lost += bytes;
            return;
        }
        if self.random.chance(conditions.corrupt.get()) {
            self.tally.dropped.corrupted += bytes;
            return;
        }
        if self.random.chance(conditions.duplicate.get()) {
            self.tally.duplicated += bytes;
            self.fly(sent, &conditions, parcel.clone());
        }
        self.fly(sent, &conditions, parcel);
    }

    fn fly(&mut self, sent: Instant, conditions: &Conditions, parcel: Parcel<P>) {
        let bytes = self.frame_bytes(&parcel);
        self.tally.flying += bytes;
        let delay = self.variation.delay(conditions.delay, conditions.jitter.as_ref());
        let detour = conditions.reorder.filter(|reorder| self.random.chance(reorder.share.get()));
        let arrival = match detour {
            Some(reorder) => sent.after(delay + reorder.by),
            None if conditions.jitter.is_some_and(|jitter| jitter.reorders) => sent.after(delay),
            None => {
                self.last_arrival = self.last_arrival.max(sent.after(delay));
                self.last_arrival
            }
        };
        self.actions.push_back(Action::Arrive(arrival, parcel));
    }

    /// The sending time of so many bytes, rounded up to a nanosecond. While the line stays busy the rounding
    /// is taken off the next time, so many packets in a row take exactly as long as their bits.
    fn sending_time(&mut self, now: Instant, rate: Rate, line_bytes: u32) -> Duration {
        if now > self.busy_until {
            self.residue = 0;
        }
        let rate = u128::from(rate.bits_per_second());
        let work = u128::from(line_bytes) * 8 * 1_000_000_000;
        let due = work.saturating_sub(u128::from(self.residue));
        let nanos = due.div_ceil(rate);
        self.residue = u64::try_from(nanos * rate - due).unwrap_or(0);
        Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
    }

    fn left(&mut self, at: Instant, parcel: &Parcel<P>) {
        if let Some(token) = parcel.token {
            self.actions.push_back(Action::Left { at, token, ip_bytes: parcel.ip_bytes });
        }
    }

    fn frame_bytes(&self, parcel: &Parcel<P>) -> u32 {
        self.model.framing.frame_bytes(parcel.ip_bytes)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{
        CoDel, Discipline, Framing, GilbertElliott, Jitter, Loss, Probability, QueueModel, Reorder,
    };
    use super::*;
    use crate::HostId;
    use crate::events::Events;

    enum Event {
        Free,
        Arrive(Parcel<usize>),
        Left(u32),
        Offer(u32),
    }

    /// Packets that came out of a link with their times, and the times at which packets left their senders.
    struct Outcome {
        pipe: Pipe<usize>,
        arrived: Vec<(u64, usize)>,
        left: Vec<(u64, u32)>,
    }

    /// Offers IP packets of these sizes at these times, and follows each until `end`.
    fn run(model: LinkModel, seed: u64, offers: impl IntoIterator<Item = (u64, u32)>, end: u64) -> Outcome {
        let mut out = Outcome { pipe: Pipe::new(model, seed), arrived: Vec::new(), left: Vec::new() };
        let mut events = Events::new();
        for (at, bytes) in offers {
            events.add(Instant::from_nanos(at), Event::Offer(bytes));
        }
        let (from, to, mut number) = (HostId(0), HostId(1), 0);
        while let Some((now, event)) = events.next_by(Instant::from_nanos(end)) {
            match event {
                Event::Offer(ip_bytes) => {
                    let token = u32::try_from(number).ok();
                    out.pipe.offer(
                        now,
                        Parcel { from, to, ip_bytes, ecn: Ecn::NotCapable, token, packet: number },
                    );
                    number += 1;
                }
                Event::Free => out.pipe.free(now),
                Event::Arrive(parcel) => {
                    out.pipe.arrived(&parcel);
                    out.arrived.push((now.as_nanos(), parcel.packet));
                }
                Event::Left(token) => out.left.push((now.as_nanos(), token)),
            }
            while let Some(action) = out.pipe.next_action() {
                match action {
                    Action::Wake(at) => events.add(at, Event::Free),
                    Action::Arrive(at, parcel) => events.add(at, Event::Arrive(parcel)),
                    Action::Left { at, token, .. } => events.add(at, Event::Left(token)),
                }
            }
            assert!(out.pipe.tally().is_balanced(), "{:?}", out.pipe.tally());
        }
        out
    }

    fn megabits(rate: u64, delay_us: u64) -> LinkModel {
        LinkModel::clean(Rate::new(rate * 1_000_000), Duration::from_micros(delay_us))
    }

    const FOREVER: u64 = u64::MAX;

    #[test]
    fn a_packet_takes_its_sending_time_and_the_delay() {
        // 1538 bytes on the line at 100 Mbit/s are 123,040 ns.
        let out = run(megabits(100, 5), 1, [(0, 1500), (0, 1500), (1_000_000, 46)], FOREVER);
        let short = 1_000_000 + 84 * 8 * 10 + 5000;
        assert_eq!(out.arrived, [(123_040 + 5000, 0), (2 * 123_040 + 5000, 1), (short, 2)]);
        assert_eq!(out.left, [(123_040, 0), (2 * 123_040, 1), (short - 5000, 2)]);
    }

    #[test]
    fn many_packets_in_a_row_take_exactly_as_long_as_their_bits() {
        // At 7 Gbit/s a packet takes 1757.71.. ns.
        let out = run(megabits(7000, 0), 1, (0..7000).map(|_| (0, 1500)), FOREVER);
        assert_eq!(out.arrived.last(), Some(&(1538 * 8 * 1000, 6999)));
        for (index, (at, _)) in out.arrived.iter().enumerate() {
            let exact = 1538.0 * 8.0 * (index as f64 + 1.0) / 7.0;
            assert!((*at as f64 - exact) >= 0.0 && (*at as f64 - exact) < 1.0, "{at} {exact}");
        }
    }

    #[test]
    fn without_a_rate_nothing_queues() {
        let out =
            run(LinkModel::clean(None, Duration::from_micros(5)), 1, (0..50).map(|_| (3, 1500)), FOREVER);
        assert!(out.arrived.iter().all(|(at, _)| *at == 5003));
        assert_eq!(out.arrived.len(), 50);
    }

    #[test]
    fn a_full_queue_drops_the_newest() {
        let mut model = megabits(100, 0);
        model.queue = QueueModel { packets: 3, ..QueueModel::default() };
        let out = run(model, 1, (0..10).map(|_| (0, 1500)), FOREVER);
        assert_eq!(out.arrived.iter().map(|(_, n)| *n).collect::<Vec<_>>(), [0, 1, 2, 3]);
        assert_eq!(out.pipe.tally().dropped.queue.packets, 6);
        assert_eq!(out.pipe.tally().delivered.bytes, 4 * 1518);
        assert_eq!(out.left.len(), 10, "a sender is rid of what is dropped, too");
    }

    #[test]
    fn what_is_too_large_is_dropped() {
        let out = run(megabits(100, 0), 1, [(0, 1500), (0, 1501)], FOREVER);
        assert_eq!((out.arrived.len(), out.pipe.tally().dropped.mtu.packets), (1, 1));
    }

    #[test]
    fn a_lost_packet_has_taken_its_time() {
        let mut model = megabits(100, 0);
        model.conditions.loss = Loss::Independent(Probability::new(0.5).unwrap());
        let out = run(model, 9, (0..1000).map(|_| (0, 1500)), FOREVER);
        let last = out.arrived.last().unwrap();
        assert_eq!(last.0, 123_040 * (last.1 as u64 + 1));
        let lost = out.pipe.tally().dropped.lost.packets;
        assert!((400..600).contains(&lost), "{lost}");
    }

    #[test]
    fn a_jittery_link_keeps_the_order_unless_it_may_not() {
        for reorders in [false, true] {
            let mut model = megabits(100, 5000);
            let deviation = Duration::from_millis(1);
            model.conditions.jitter = Some(Jitter {
                deviation,
                distribution: Default::default(),
                correlation: Probability::default(),
                reorders,
            });
            let out = run(model, 9, (0..500).map(|_| (0, 1500)), FOREVER);
            assert_eq!(out.arrived.len(), 500);
            assert_eq!(out.arrived.is_sorted_by_key(|(_, number)| *number), !reorders);
        }
    }

    #[test]
    fn a_detour_lets_others_overtake() {
        let mut model = megabits(100, 0);
        let (share, by) = (Probability::new(0.1).unwrap(), Duration::from_millis(1));
        model.conditions.reorder = Some(Reorder { share, by });
        let out = run(model, 9, (0..1000).map(|_| (0, 1500)), FOREVER);
        let late = out.arrived.iter().filter(|(at, n)| *at == 123_040 * (*n as u64 + 1) + 1_000_000).count();
        let timely = out.arrived.iter().filter(|(at, n)| *at == 123_040 * (*n as u64 + 1)).count();
        assert!((70..130).contains(&late) && late + timely == 1000, "{late}");
    }

    #[test]
    fn damage_and_copies_are_counted() {
        let mut model = megabits(100, 0);
        model.conditions.corrupt = Probability::new(0.1).unwrap();
        model.conditions.duplicate = Probability::new(0.2).unwrap();
        let tally = *run(model, 9, (0..1000).map(|_| (0, 1500)), FOREVER).pipe.tally();
        assert!((70..130).contains(&tally.dropped.corrupted.packets), "{tally:?}");
        assert!((140..220).contains(&tally.duplicated.packets), "{tally:?}");
        assert_eq!(
            tally.delivered.packets,
            1000 - tally.dropped.corrupted.packets + tally.duplicated.packets
        );
    }

    #[test]
    fn a_managed_queue_stays_short_under_a_steady_overload() {
        let longest = |discipline| {
            let mut model = megabits(10, 0);
            model.queue.discipline = discipline;
            // A seventh above the link's rate for 22 seconds: controlled delay takes some to settle.
            let out = run(model, 9, (0..20_000_u64).map(|n| (n * 1_076_600, 1500)), FOREVER);
            let waits: Vec<u64> = out.arrived.iter().map(|(at, n)| at - *n as u64 * 1_076_600).collect();
            (waits[waits.len() / 2..].iter().sum::<u64>() / (waits.len() / 2) as u64, *out.pipe.tally())
        };
        let (tail, _) = longest(Discipline::DropTail);
        let (managed, tally) = longest(Discipline::CoDel(CoDel { ecn: false, ..CoDel::default() }));
        assert!(tail > 200_000_000 && managed < 60_000_000, "{tail} {managed}");
        assert!(tally.dropped.managed.packets > 50, "{tally:?}");
    }

    #[test]
    fn a_packet_after_a_pause_takes_a_whole_nanosecond_more_again() {
        // 12,304 bits at 7 Mbit/s: 1,757,714 ns and 2/7.
        let out = run(megabits(7, 0), 1, [(0, 1500), (10_000_000, 1500)], FOREVER);
        assert_eq!(out.arrived, [(1_757_715, 0), (11_757_715, 1)]);
    }

    #[test]
    fn a_link_gets_slower_when_its_time_comes() {
        let mut model = megabits(100, 0);
        let slow = Conditions { rate: Rate::new(10_000_000), ..model.conditions };
        model.phases = vec![super::super::Phase { at: Duration::from_millis(1), conditions: slow }];
        let out = run(model, 1, [(0, 1500), (2_000_000, 1500)], FOREVER);
        assert_eq!(out.arrived, [(123_040, 0), (2_000_000 + 1_230_400, 1)]);
    }

    proptest! {
        #[test]
        fn every_packet_is_accounted_for_at_any_time(
            seed: u64, offers in prop::collection::vec((0_u64..20_000_000, 40_u32..1600), 0..200),
            packets in 1_u32..50, codel: bool, loss in 0.0..0.3, other in 0.0..0.2, reorders: bool, end in 0_u64..30_000_000,
        ) {
            let share = |value| Probability::new(value).unwrap();
            let mut model = megabits(10, 300);
            model.framing = Framing::Bytes(8);
            let discipline = if codel {
                Discipline::CoDel(CoDel { target: Duration::from_micros(500), interval: Duration::from_millis(2), ecn: true })
            } else {
                Discipline::DropTail
            };
            model.queue = QueueModel { packets, bytes: 20_000, discipline };
            model.conditions.loss = Loss::GilbertElliott(GilbertElliott {
                to_bad: share(loss), to_good: share(0.5), lost_in_bad: share(0.9), lost_in_good: share(other),
            });
            model.conditions.corrupt = share(other);
            model.conditions.duplicate = share(other);
            model.conditions.jitter = Some(Jitter {
                deviation: Duration::from_micros(200), distribution: Default::default(), correlation: share(other), reorders,
            });
            let mut offers = offers;
            offers.sort();
            // `run` checks the balance after each event.
            let out = run(model.clone(), seed, offers.clone(), end);
            let tally = out.pipe.tally();
            prop_assert!(tally.queued.packets <= u64::from(packets) && tally.queued.bytes <= 20_000);
            let after = run(model, seed, offers, FOREVER);
            let tally = after.pipe.tally();
            prop_assert_eq!((tally.queued.packets, tally.flying.packets), (0, 0));
            prop_assert_eq!(tally.delivered.packets as usize, after.arrived.len());
        }
    }
}
