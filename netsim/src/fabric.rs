//! All links of a topology, and the packets in flight on them.

use slab::Slab;
use trimaran_net::Instant;

use crate::events::Events;
use crate::host::HostId;
use crate::link::{Action, LinkTally, Parcel, Pipe};
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
    /// Where each pipe ends.
    ends: Vec<NodeId>,
    nodes: Vec<Option<HostId>>,
    homes: Vec<NodeId>,
    /// By host, then by node: the next pipe.
    routes: Vec<Vec<Option<usize>>>,
    flying: Slab<Parcel<P>>,
}

impl<P: Clone> Fabric<P> {
    pub(crate) fn new(topology: &Topology, seed: u64) -> Self {
        let pipe = |(index, way): (usize, &crate::topology::Way)| {
            Pipe::new(way.model.clone(), Random::stream(seed, index as u64).bits())
        };
        Self {
            pipes: topology.pipes.iter().enumerate().map(pipe).collect(),
            ends: topology.pipes.iter().map(|way| way.to).collect(),
            nodes: topology.nodes.iter().map(|node| node.host).collect(),
            homes: topology.hosts.clone(),
            routes: (0..topology.hosts.len()).map(|host| topology.routes_to(HostId(host))).collect(),
            flying: Slab::new(),
        }
    }

    pub(crate) fn tallies(&self) -> Vec<LinkTally> {
        self.pipes.iter().map(|pipe| *pipe.tally()).collect()
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
        self.on(pipe, events, |pipe| pipe.offer(now, parcel));
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
                if let Some(pipe) = self.pipes.get_mut(pipe) {
                    pipe.arrived(&parcel);
                }
                let Some(&node) = self.ends.get(pipe) else { return Outcome::Underway };
                if self.nodes.get(node.0).is_some_and(|host| *host == Some(parcel.to)) {
                    return Outcome::Delivered(parcel);
                }
                if let Some(next) = self.route(node, parcel.to) {
                    parcel.token = None; // it has left its host long ago
                    self.on(next, events, |pipe| pipe.offer(now, parcel));
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
