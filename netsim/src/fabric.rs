//! All links of a topology, and the packets in flight on them.

use std::collections::BTreeSet;

use slab::Slab;
use trimaran_net::Instant;

use crate::events::Events;
use crate::host::HostId;
use crate::link::{Action, LinkTally, Outage, Parcel, Pipe};
use crate::random::Random;
use crate::topology::{NodeId, Topology};

/// An event on a link.
#[derive(Debug, Clone, Copy)]
pub(crate) enum LinkEvent {
    /// A pipe's line is free.
    Free { pipe: usize },
    /// A packet comes out of a pipe.
    Arrive { pipe: usize, packet: usize },
    /// A packet has left the host that sent it.
    Left { token: u32, ip_bytes: u32 },
}

/// The effect of a link event on hosts.
pub(crate) enum Outcome<P> {
    /// Nothing yet.
    Underway,
    /// The packet has arrived.
    Delivered(Parcel<P>),
    /// So many bytes of the token's owner have left the host.
    Left { token: u32, ip_bytes: u32 },
}

#[derive(Debug)]
pub(crate) struct Fabric<P> {
    pipes: Vec<Pipe<P>>,
    /// Where each pipe begins and ends.
    starts: Vec<NodeId>,
    ends: Vec<NodeId>,
    nodes: Vec<Option<HostId>>,
    homes: Vec<NodeId>,
    /// By host, then by node: the next pipe.
    routes: Vec<Vec<Option<usize>>>,
    flying: Slab<Parcel<P>>,
    /// Pairs of hosts, the lower id first.
    partitions: BTreeSet<(HostId, HostId)>,
    down: BTreeSet<HostId>,
}

impl<P: Clone> Fabric<P> {
    pub(crate) fn new(topology: &Topology, seed: u64) -> Self {
        let pipe = |(index, way): (usize, &crate::topology::Way)| {
            Pipe::new(way.model.clone(), Random::stream(seed, index as u64).bits())
        };
        Self {
            pipes: topology.pipes.iter().enumerate().map(pipe).collect(),
            starts: topology.pipes.iter().map(|way| way.from).collect(),
            ends: topology.pipes.iter().map(|way| way.to).collect(),
            nodes: topology.nodes.iter().map(|node| node.host).collect(),
            homes: topology.hosts.clone(),
            routes: (0..topology.hosts.len()).map(|host| topology.routes_to(HostId(host))).collect(),
            flying: Slab::new(),
            partitions: BTreeSet::new(),
            down: BTreeSet::new(),
        }
    }

    pub(crate) fn tallies(&self) -> Vec<LinkTally> {
        self.pipes.iter().map(|pipe| *pipe.tally()).collect()
    }

    pub(crate) fn partition(&mut self, a: HostId, b: HostId) {
        self.partitions.insert((a.min(b), a.max(b)));
    }

    pub(crate) fn heal(&mut self, a: HostId, b: HostId) {
        self.partitions.remove(&(a.min(b), a.max(b)));
    }

    fn is_partitioned(&self, parcel: &Parcel<P>) -> bool {
        let Parcel { from, to, .. } = *parcel;
        self.partitions.contains(&(from.min(to), from.max(to)))
    }

    /// Takes a host down, and with it what waits in its queues.
    pub(crate) fn take_down(&mut self, host: HostId) {
        self.down.insert(host);
        let home = self.homes.get(host.0);
        let own = self.pipes.iter_mut().zip(&self.starts).filter(|(_, start)| Some(*start) == home);
        own.for_each(|(pipe, _)| pipe.drop_queue());
    }

    pub(crate) fn bring_up(&mut self, host: HostId) {
        self.down.remove(&host);
    }

    pub(crate) fn is_down(&self, host: HostId) -> bool {
        self.down.contains(&host)
    }

    /// The link from one node to another, and of several the first.
    pub(crate) fn link(&mut self, from: NodeId, to: NodeId) -> Option<&mut Pipe<P>> {
        let ends = self.starts.iter().zip(&self.ends);
        self.pipes.iter_mut().zip(ends).find(|(_, ends)| *ends == (&from, &to)).map(|(pipe, _)| pipe)
    }

    /// The pipes from one host to another.
    fn way(&self, from: HostId, to: HostId) -> impl Iterator<Item = &Pipe<P>> {
        let mut node = self.homes.get(from.0).copied();
        std::iter::from_fn(move || {
            let index = self.route(node?, to)?;
            node = self.ends.get(index).copied();
            self.pipes.get(index)
        })
    }

    fn route(&self, node: NodeId, to: HostId) -> Option<usize> {
        *self.routes.get(to.0)?.get(node.0)?
    }

    /// The path MTU from one host to another; `None` without a path.
    pub(crate) fn path_mtu(&self, from: HostId, to: HostId) -> Option<u32> {
        self.way(from, to).map(|pipe| pipe.model().mtu).min()
    }

    /// The bytes that the link layer adds to a packet where it leaves `from`.
    pub(crate) fn framing(&self, from: HostId, to: HostId, ip_bytes: u32) -> u32 {
        let first = self.way(from, to).next();
        first.map_or(0, |pipe| pipe.model().framing.frame_bytes(ip_bytes) - ip_bytes)
    }

    /// Sends a packet. Without a path it is dropped at once.
    pub(crate) fn send<E: From<LinkEvent>>(
        &mut self,
        now: Instant,
        parcel: Parcel<P>,
        events: &mut Events<E>,
    ) {
        let first = self.homes.get(parcel.from.0).and_then(|home| self.route(*home, parcel.to));
        let Some(pipe) = first else {
            if let Parcel { token: Some(token), ip_bytes, .. } = parcel {
                events.add(now, LinkEvent::Left { token, ip_bytes }.into());
            }
            return;
        };
        self.offer(now, pipe, parcel, events);
    }

    fn offer<E: From<LinkEvent>>(
        &mut self,
        now: Instant,
        index: usize,
        parcel: Parcel<P>,
        events: &mut Events<E>,
    ) {
        if self.is_partitioned(&parcel) {
            self.on(index, events, |pipe| pipe.refuse(now, &parcel));
        } else {
            self.on(index, events, |pipe| pipe.offer(now, parcel));
        }
    }

    pub(crate) fn happen<E: From<LinkEvent>>(
        &mut self,
        now: Instant,
        event: LinkEvent,
        events: &mut Events<E>,
    ) -> Outcome<P> {
        match event {
            LinkEvent::Left { token, ip_bytes } => Outcome::Left { token, ip_bytes },
            LinkEvent::Free { pipe } => {
                self.on(pipe, events, |pipe| pipe.free(now));
                Outcome::Underway
            }
            LinkEvent::Arrive { pipe, packet } => {
                let Some(mut parcel) = self.flying.try_remove(packet) else { return Outcome::Underway };
                let Some(&node) = self.ends.get(pipe) else { return Outcome::Underway };
                let is_there = self.nodes.get(node.0).is_some_and(|host| *host == Some(parcel.to));
                let outage = if self.is_partitioned(&parcel) {
                    Some(Outage::Partition)
                } else {
                    (is_there && self.is_down(parcel.to)).then_some(Outage::Down)
                };
                if let Some(pipe) = self.pipes.get_mut(pipe) {
                    match outage {
                        None => pipe.arrived(&parcel),
                        Some(cause) => {
                            pipe.drop_arrived(&parcel, cause);
                            return Outcome::Underway;
                        }
                    }
                }
                if is_there {
                    return Outcome::Delivered(parcel);
                }
                if let Some(next) = self.route(node, parcel.to) {
                    parcel.token = None; // it has left its host long ago
                    self.offer(now, next, parcel, events);
                }
                Outcome::Underway
            }
        }
    }

    /// Calls a pipe, then carries out its actions.
    fn on<E: From<LinkEvent>>(
        &mut self,
        index: usize,
        events: &mut Events<E>,
        act: impl FnOnce(&mut Pipe<P>),
    ) {
        let Some(pipe) = self.pipes.get_mut(index) else { return };
        act(pipe);
        while let Some(action) = pipe.next_action() {
            match action {
                Action::Wake(at) => events.add(at, LinkEvent::Free { pipe: index }.into()),
                Action::Arrive(at, parcel) => {
                    let packet = self.flying.insert(parcel);
                    events.add(at, LinkEvent::Arrive { pipe: index, packet }.into());
                }
                Action::Left { at, token, ip_bytes } => {
                    events.add(at, LinkEvent::Left { token, ip_bytes }.into());
                }
            }
        }
    }
}
