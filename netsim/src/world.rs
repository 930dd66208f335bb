//! The state of a simulation: time, events, hosts and links.

use parking_lot::{Mutex, MutexGuard};
use std::collections::BTreeMap;
use std::fmt;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};

use trimaran_net::Instant;
use xxhash_rust::xxh3::Xxh3;

use crate::capture::Capture;
use crate::events::Events;
use crate::executor::Executor;
use crate::fabric::{Fabric, LinkEvent, Outcome};
use crate::host::HostId;
use crate::link::Parcel;
use crate::packet::{Body, Packet};
use crate::random::Random;
use crate::tcp::Class;
use crate::timers::{Rung, Timers};
use crate::topology::Topology;
use crate::wire::WireTally;

mod crash;
mod tcp;
mod udp;

pub(crate) use tcp::{ListenerState, TcpState};
pub(crate) use udp::{Datagram, UdpState};

/// The world, shared by all sockets and timers in it. One thread at a time uses it.
#[derive(Debug)]
pub(crate) struct World {
    pub(crate) executor: Executor,
    /// Nanoseconds; a copy of the core's, to be read without its lock.
    now: AtomicU64,
    core: Mutex<Core>,
}

/// The state behind the lock.
pub(crate) struct Core {
    pub(crate) now: Instant,
    pub(crate) random: Random,
    pub(crate) timers: Timers,
    pub(crate) sockets: BTreeMap<u32, UdpState>,
    /// The socket of each UDP port of a host.
    pub(crate) udp_ports: BTreeMap<(HostId, u16), u32>,
    pub(crate) tcp: BTreeMap<u32, TcpState>,
    /// The connection of each port of a host and peer's address.
    pub(crate) tcp_ports: BTreeMap<(HostId, u16, SocketAddr), u32>,
    pub(crate) listeners: BTreeMap<(HostId, u16), ListenerState>,
    /// Where each host looks for a port to connect from; also after a crash.
    pub(crate) next_ports: BTreeMap<HostId, u16>,
    /// Packets are passed on from queue to queue: by pointer.
    pub(crate) fabric: Fabric<Box<Packet>>,
    pub(crate) names: Vec<String>,
    last_socket: u32,
    events: Events<Event>,
    trace: Xxh3,
    wire: BTreeMap<(HostId, HostId, Class), WireTally>,
    pub(crate) capture: Option<Capture>,
}

/// A future event.
#[derive(Debug, Clone, Copy)]
enum Event {
    Timer(usize),
    /// A host's runtime wakes by itself.
    Wake(HostId),
    Tcp(u32),
    Link(LinkEvent),
}

impl From<LinkEvent> for Event {
    fn from(event: LinkEvent) -> Self {
        Self::Link(event)
    }
}

impl fmt::Debug for Core {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Core").field("now", &self.now).finish_non_exhaustive()
    }
}

impl World {
    pub(crate) fn new(topology: &Topology, seed: u64) -> Self {
        let start = Instant::from_nanos(0);
        let core = Core {
            now: start,
            random: Random::stream(seed, 0),
            timers: Timers::default(),
            sockets: BTreeMap::new(),
            udp_ports: BTreeMap::new(),
            tcp: BTreeMap::new(),
            tcp_ports: BTreeMap::new(),
            listeners: BTreeMap::new(),
            next_ports: BTreeMap::new(),
            fabric: Fabric::new(topology, Random::stream(seed, 1).bits()),
            names: topology.host_names().map(str::to_owned).collect(),
            last_socket: 0,
            events: Events::new(),
            trace: Xxh3::new(),
            wire: BTreeMap::new(),
            capture: None,
        };
        Self { executor: Executor::default(), now: AtomicU64::new(0), core: Mutex::new(core) }
    }

    pub(crate) fn core(&self) -> MutexGuard<'_, Core> {
        self.core.lock()
    }

    pub(crate) fn now(&self) -> Instant {
        Instant::from_nanos(self.now.load(Ordering::Relaxed))
    }

    /// Advances to the next event that wakes a task; false if there is none.
    pub(crate) fn go_on(&self) -> bool {
        self.go_on_until(Instant::from_nanos(u64::MAX))
    }

    /// The same, but not beyond a time.
    pub(crate) fn go_on_until(&self, end: Instant) -> bool {
        let mut core = self.core();
        while let Some((at, event)) = core.events.next_by(end) {
            self.pass(&mut core, at);
            core.happen(event);
            if self.executor.is_ready() {
                return true;
            }
        }
        false
    }

    /// Advances to `now`, without events since the last one. Returns the time of the next one.
    pub(crate) fn idle_until(&self, now: Instant) -> Option<Instant> {
        let mut core = self.core();
        self.pass(&mut core, now);
        core.events.next_at()
    }

    fn pass(&self, core: &mut Core, now: Instant) {
        core.now = now;
        self.now.store(now.as_nanos(), Ordering::Relaxed);
    }
}

impl Core {
    /// The host of this name.
    pub(crate) fn find(&self, name: &str) -> Option<HostId> {
        self.names.iter().position(|known| known == name).map(HostId)
    }

    /// A number for a new socket that no socket has had.
    pub(crate) const fn new_socket(&mut self) -> u32 {
        self.last_socket += 1;
        self.last_socket
    }

    /// Sets a timer.
    pub(crate) fn set_timer(&mut self, key: usize, at: Instant) {
        if let Some(at) = self.timers.set(key, at) {
            self.events.add(at.max(self.now), Event::Timer(key));
        }
    }

    /// Wakes a host's runtime.
    pub(crate) fn rouse(&mut self, host: HostId) {
        self.timers.rouse(self.now, host);
    }

    /// Sends a packet. `token` is told when it has left the host.
    pub(crate) fn send(&mut self, packet: Box<Packet>, token: Option<u32>) {
        self.note(0, &packet);
        if let Some(capture) = &mut self.capture {
            let mtu = self.fabric.path_mtu(packet.from, packet.to).unwrap_or_default();
            capture.add(self.now, &packet, mtu);
        }
        let ip_bytes = packet.ip_bytes();
        if packet.from == packet.to {
            if let Some(token) = token {
                self.left(token, ip_bytes);
            }
            self.deliver(*packet);
            return;
        }
        *self.wire.entry((packet.from, packet.to, packet.class())).or_default() += WireTally {
            packets: 1,
            payload: packet.payload().into(),
            transport_headers: packet.transport_header().into(),
            ip_headers: packet.ip_header().into(),
            link_layer: self.fabric.framing(packet.from, packet.to, ip_bytes).into(),
        };
        let Packet { from, to, ecn, .. } = *packet;
        let parcel = Parcel { from, to, ip_bytes, ecn, token, packet };
        self.fabric.send(self.now, parcel, &mut self.events);
    }

    /// Has a connection look at its timers at this time.
    pub(crate) fn wake_tcp(&mut self, number: u32, at: Instant) {
        self.events.add(at.max(self.now), Event::Tcp(number));
    }

    /// The packets that one host sent to another, by purpose.
    pub(crate) fn sent(&self, from: HostId, to: HostId) -> BTreeMap<Class, WireTally> {
        let sent = self.wire.iter().filter(|((f, t, _), _)| (*f, *t) == (from, to));
        sent.map(|((_, _, class), tally)| (*class, *tally)).collect()
    }

    pub(crate) fn trace_hash(&self) -> u64 {
        self.trace.digest()
    }

    fn happen(&mut self, event: Event) {
        match event {
            Event::Timer(key) => self.ring(key),
            Event::Wake(host) if self.timers.sleeps_late(host) => self.rouse(host),
            Event::Wake(_) => {}
            Event::Tcp(number) => self.tcp_timer(number),
            Event::Link(event) => match self.fabric.happen(self.now, event, &mut self.events) {
                Outcome::Underway => {}
                Outcome::Delivered(Parcel { packet, ecn, .. }) => {
                    self.note(1, &packet);
                    self.deliver(Packet { ecn, ..*packet });
                }
                Outcome::Left { token, ip_bytes } => self.left(token, ip_bytes),
            },
        }
    }

    fn ring(&mut self, key: usize) {
        match self.timers.ring(self.now, key) {
            Rung::Done => {}
            Rung::Again(at) => self.events.add(at, Event::Timer(key)),
            Rung::Asleep(host, until) => self.events.add(until, Event::Wake(host)),
        }
    }

    fn deliver(&mut self, packet: Packet) {
        let port = (packet.to, packet.dst.port());
        match packet.body {
            Body::Udp(data) => {
                let socket = self.udp_ports.get(&port).and_then(|number| self.sockets.get_mut(number));
                if socket.is_some_and(|socket| socket.receive(packet.src, packet.dst, packet.ecn, data)) {
                    self.rouse(packet.to);
                }
            }
            Body::Tcp(segment) => self.tcp_segment(packet.to, packet.from, packet.dst, packet.src, &segment),
        }
    }

    fn left(&mut self, token: u32, ip_bytes: u32) {
        if let Some(socket) = self.sockets.get_mut(&token) {
            if let Some(host) = socket.left(ip_bytes) {
                self.rouse(host);
            }
        } else {
            self.tcp_left(token, ip_bytes);
        }
    }

    /// Adds a packet to the trace: time, addresses, kind and size. Encrypted contents differ from run to run,
    /// so contents are left out.
    fn note(&mut self, what: u8, packet: &Packet) {
        let mut record = [0; 24];
        let mut rest = record.as_mut_slice();
        for part in [
            &self.now.as_nanos().to_le_bytes()[..],
            &packet.ip_bytes().to_le_bytes(),
            &(packet.from.0 as u16).to_le_bytes(),
            &(packet.to.0 as u16).to_le_bytes(),
            &packet.src.port().to_le_bytes(),
            &packet.dst.port().to_le_bytes(),
            &[what, packet.protocol()],
        ] {
            let (place, after) = rest.split_at_mut(part.len());
            place.copy_from_slice(part);
            rest = after;
        }
        self.trace.update(&record);
    }
}
