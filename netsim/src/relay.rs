//! Links at work on packets of any kind, by anyone's clock.

use std::collections::VecDeque;

use serde::Serialize;
use trimaran_net::Instant;

use crate::events::Events;
use crate::fabric::{Fabric, LinkEvent, Outcome};
use crate::host::HostId;
use crate::link::{Ecn, LinkTally, Parcel};
use crate::random::Random;
use crate::topology::Topology;

/// The links of a topology without hosts: packets go in where they leave a host, and come out where and
/// when they arrive at another. The links are those of a [`Simulation`](crate::Simulation), with the same
/// random streams for the same seed.
///
/// Sans-IO: the owner keeps the time. Due events happen at their own times, however late the owner calls, so
/// lateness does not add up.
#[derive(Debug)]
pub struct Relay<P> {
    fabric: Fabric<P>,
    events: Events<LinkEvent>,
    arrived: VecDeque<Arrival<P>>,
    offered: u64,
    delivered: u64,
}

/// A packet that has arrived at its host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Arrival<P> {
    /// The time.
    pub at: Instant,
    /// The host.
    pub to: HostId,
    /// Its ECN field now: a queue may have marked it.
    pub ecn: Ecn,
    /// The packet.
    pub packet: P,
}

/// Delivery counts over all links. Each packet counts once, however many links it takes.
///
/// At any time `sent + duplicated = delivered + mtu + queue + managed + lost + corrupted + underway`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Totals {
    /// Sent by a host.
    pub sent: u64,
    /// Copies that links made.
    pub duplicated: u64,
    /// Arrived at their hosts.
    pub delivered: u64,
    /// Larger than a link's MTU.
    pub mtu: u64,
    /// Dropped because a queue was full.
    pub queue: u64,
    /// Dropped to keep a queue short.
    pub managed: u64,
    /// Lost on the way.
    pub lost: u64,
    /// Damaged on the way.
    pub corrupted: u64,
    /// In a queue or on a link.
    pub underway: u64,
}

impl Totals {
    /// Whether every packet is accounted for.
    #[must_use]
    pub const fn is_balanced(&self) -> bool {
        let dropped = self.mtu + self.queue + self.managed + self.lost + self.corrupted;
        self.sent + self.duplicated == self.delivered + dropped + self.underway
    }
}

impl<P: Clone> Relay<P> {
    /// The links of `topology`, all idle.
    #[must_use]
    pub fn new(topology: &Topology, seed: u64) -> Self {
        Self {
            fabric: Fabric::new(topology, Random::stream(seed, 1).bits()),
            events: Events::new(),
            arrived: VecDeque::new(),
            offered: 0,
            delivered: 0,
        }
    }

    /// A packet leaves its host; tokens are not told. Without a path it is dropped and not counted.
    pub fn offer(&mut self, now: Instant, parcel: Parcel<P>) {
        if self.fabric.path_mtu(parcel.from, parcel.to).is_none() {
            return;
        }
        self.pass(now);
        self.offered += 1;
        self.fabric.send(now, parcel, &mut self.events);
    }

    /// The next packet that has arrived by now.
    pub fn arrival(&mut self, now: Instant) -> Option<Arrival<P>> {
        if self.arrived.is_empty() {
            self.pass(now);
        }
        self.arrived.pop_front()
    }

    /// When to ask for arrivals again, if nothing is offered before.
    #[must_use]
    pub fn next_at(&self) -> Option<Instant> {
        self.arrived.front().map(|arrival| arrival.at).or_else(|| self.events.next_at())
    }

    /// The tally of each direction of each link, in the order of [`Topology::link_names`].
    #[must_use]
    pub fn links(&self) -> Vec<LinkTally> {
        self.fabric.tallies()
    }

    /// The totals over all packets.
    #[must_use]
    pub fn totals(&self) -> Totals {
        let start = Totals { sent: self.offered, delivered: self.delivered, ..Totals::default() };
        self.fabric.tallies().iter().fold(start, |mut all, link| {
            all.duplicated += link.duplicated.packets;
            all.mtu += link.dropped.mtu.packets;
            all.queue += link.dropped.queue.packets;
            all.managed += link.dropped.managed.packets;
            all.lost += link.dropped.lost.packets;
            all.corrupted += link.dropped.corrupted.packets;
            all.underway += link.queued.packets + link.flying.packets;
            all
        })
    }

    /// Processes all due events.
    fn pass(&mut self, now: Instant) {
        while let Some((at, event)) = self.events.next_by(now) {
            if let Outcome::Delivered(parcel) = self.fabric.happen(at, event, &mut self.events) {
                let Parcel { to, ecn, packet, .. } = parcel;
                self.delivered += 1;
                self.arrived.push_back(Arrival { at, to, ecn, packet });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use proptest::prelude::*;

    use super::*;
    use crate::link::{CoDel, Discipline, LinkModel, Loss, Probability, Rate};

    fn star(model: &LinkModel) -> (Topology, [HostId; 3]) {
        (Topology::star(&["a", "b", "c"], model, model), [HostId(0), HostId(1), HostId(2)])
    }

    fn parcel<P>(from: HostId, to: HostId, packet: P) -> Parcel<P> {
        Parcel { from, to, ip_bytes: 1500, ecn: Ecn::default(), token: None, packet }
    }

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    #[test]
    fn a_late_owner_gets_packets_with_the_times_at_which_they_came() {
        let (topology, [a, b, c]) = star(&LinkModel::clean(Rate::new(100_000_000), Duration::from_micros(5)));
        let mut relay = Relay::new(&topology, 1);
        relay.offer(at(0), parcel(a, b, 'x'));
        relay.offer(at(0), parcel(a, c, 'y'));
        // 1538 bytes on two lines, 5 us on each; the first call comes after a second.
        assert_eq!(relay.next_at(), Some(at(123_040)));
        let mut got = Vec::new();
        while let Some(arrival) = relay.arrival(at(1_000_000_000)) {
            got.push((arrival.at.as_nanos(), arrival.to, arrival.packet));
        }
        assert_eq!(got, [(256_080, b, 'x'), (256_080 + 123_040, c, 'y')]);
        assert_eq!(relay.next_at(), None);
    }

    #[test]
    fn what_was_due_before_an_offer_happens_before_it() {
        let (topology, [a, b, _]) = star(&LinkModel::clean(Rate::new(100_000_000), Duration::ZERO));
        let mut relay = Relay::new(&topology, 1);
        relay.offer(at(0), parcel(a, b, 1));
        relay.offer(at(10_000_000), parcel(a, b, 2));
        assert_eq!(
            relay.next_at(),
            Some(at(246_080)),
            "the first has arrived long ago and waits to be fetched"
        );
        assert_eq!(relay.arrival(at(10_000_000)).map(|arrival| arrival.packet), Some(1));
        assert_eq!(relay.arrival(at(10_000_000)), None);
        assert_eq!(relay.arrival(at(10_246_080)).map(|arrival| arrival.packet), Some(2));
    }

    #[test]
    fn a_packet_that_a_queue_has_marked_arrives_marked() {
        let mut model = LinkModel::clean(Rate::new(10_000_000), Duration::ZERO);
        model.queue.discipline = Discipline::CoDel(CoDel::default());
        let (topology, [a, b, _]) = star(&model);
        let mut relay = Relay::new(&topology, 1);
        for packet in 0..2000 {
            // A seventh above the link's rate.
            let now = at(packet * 1_076_600);
            relay.offer(now, Parcel { ecn: Ecn::Capable0, ..parcel(a, b, ()) });
        }
        let mut marked = 0;
        while let Some(arrival) = relay.arrival(at(u64::MAX)) {
            marked += u64::from(arrival.ecn == Ecn::Experienced);
        }
        let by_links: u64 = relay.links().iter().map(|link| link.marked.packets).sum();
        assert!(marked > 5, "{marked}");
        assert_eq!((marked, relay.totals().managed), (by_links, 0));
    }

    #[test]
    fn hosts_that_nothing_joins_hear_nothing_of_each_other() {
        let mut topology = Topology::new();
        let (a, b) = (topology.host("a"), topology.host("b"));
        let mut relay = Relay::new(&topology, 1);
        relay.offer(at(0), parcel(a, b, ()));
        assert_eq!((relay.totals(), relay.next_at()), (Totals::default(), None));
    }

    proptest! {
        #[test]
        fn every_packet_is_accounted_for_over_several_links(
            seed: u64, offers in prop::collection::vec((0_u64..2_000_000, 40_u32..1700, 0..6_usize), 0..200), end in 0_u64..4_000_000,
        ) {
            let share = |value| Probability::new(value).unwrap();
            let mut model = LinkModel::clean(Rate::new(20_000_000), Duration::from_micros(300));
            model.queue.packets = 8;
            (model.conditions.corrupt, model.conditions.duplicate) = (share(0.05), share(0.05));
            model.conditions.loss = Loss::Independent(share(0.1));
            let (topology, hosts) = star(&model);
            let mut relay = Relay::new(&topology, seed);
            let mut offers = offers;
            offers.sort();
            for (when, ip_bytes, pair) in &offers {
                let (from, to) = (hosts[pair % 3], hosts[(pair + 1 + pair / 3) % 3]);
                relay.offer(at(*when), Parcel { ip_bytes: *ip_bytes, ..parcel(from, to, ()) });
                prop_assert!(relay.totals().is_balanced(), "{:?}", relay.totals());
            }
            let mut fetched = 0;
            for now in [end, u64::MAX] {
                while relay.arrival(at(now)).is_some() {
                    fetched += 1;
                }
                prop_assert!(relay.totals().is_balanced(), "{:?}", relay.totals());
            }
            let Totals { sent, delivered, underway, .. } = relay.totals();
            prop_assert_eq!((sent, delivered, underway), (offers.len() as u64, fetched, 0));
        }
    }
}
