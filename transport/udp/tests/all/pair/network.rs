//! Two ends in virtual time, and the network between them.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::net::SocketAddr;
use std::ops::Range;
use std::time::Duration;

use trimaran_net::Instant;
use trimaran_udp::{
    Acceptor, Config, Connecting, Connection, ConnectionId, Handled, MIN_DATAGRAM, Progress, Security,
};

/// The impairments of packets, in 1/1000.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Network {
    pub(crate) loss: u64,
    pub(crate) twice: u64,
    pub(crate) late: u64,
    pub(crate) broken: u64,
    /// How often a packet begins a burst (Gilbert and Elliott): one in four ends it, and within it three of
    /// four are lost.
    pub(crate) bursts: u64,
    /// Longer packets are lost.
    pub(crate) mtu: usize,
    /// Whether packets are encrypted.
    pub(crate) sealed: bool,
    pub(crate) seed: u64,
}

pub(crate) const CLEAN: Network =
    Network { loss: 0, twice: 0, late: 0, broken: 0, bursts: 0, mtu: MIN_DATAGRAM, sealed: false, seed: 1 };
pub(crate) const SEALED: Network = Network { sealed: true, ..CLEAN };
pub(crate) const ONE_WAY: Duration = Duration::from_millis(5);

/// A packet in flight: its arrival, its order among equal arrivals, source, destination, bytes.
type Flight = (Instant, u64, SocketAddr, SocketAddr, Vec<u8>);

pub(crate) fn address(host: u8, port: u16) -> SocketAddr {
    ([10, 0, 0, host], port).into()
}

/// Two ends that have met at an acceptor and share a key.
fn introduce(now: Instant, here: ConnectionId, there: ConnectionId, config: Config) -> [Connection; 2] {
    let key = Security::PreShared([9; 32].into());
    let acceptor = Acceptor::new(key.clone(), [3; 32], 7400).unwrap();
    let address = SocketAddr::from(([192, 0, 2, 1], 4000));
    let connecting = Connecting::new(&key, here, b"").unwrap();
    let (mut first, mut reply) = (Vec::new(), Vec::new());
    connecting.initial(&mut first);
    let _retry = acceptor.handle(now, address, &first, &mut reply);
    let Progress::Retry(connecting) = connecting.handle(now, &reply, config) else { panic!("no retry") };
    connecting.initial(&mut first);
    let Handled::Initial(initial) = acceptor.handle(now, address, &first, &mut reply) else {
        panic!("no initial")
    };
    let listener = initial.take(now, there, b"", config, &mut reply).unwrap();
    // The other steps take no time here, the last one a round trip.
    let Progress::Taken(ours, _) = connecting.handle(now.after(2 * ONE_WAY), &reply, config) else {
        panic!("not taken")
    };
    [*ours, listener]
}

pub(crate) struct Pair {
    pub(crate) now: Instant,
    pub(crate) ends: [Connection; 2],
    /// The address of each.
    pub(crate) at: [SocketAddr; 2],
    pub(crate) network: Network,
    pub(crate) flying: BinaryHeap<Reverse<Flight>>,
    count: u64,
    pub(crate) sent: u64,
    pub(crate) bytes: [u64; 2],
    pub(crate) longest: usize,
    /// Whether each direction is in a burst; packets lost to bursts.
    in_burst: [bool; 2],
    pub(crate) burst_losses: u64,
    /// Bytes that arrived at addresses without an end.
    pub(crate) astray: BTreeMap<SocketAddr, usize>,
    /// The address of an attacker that repeats all packets of the second end, faster than the network.
    pub(crate) echo: Option<SocketAddr>,
    /// Nothing that the first end sends arrives.
    pub(crate) deaf: bool,
    /// The first end does nothing before this time: its machine does not let it run.
    pub(crate) asleep_until: Instant,
}

impl Pair {
    pub(crate) fn new(network: Network, config: Config) -> Self {
        let now = Instant::from_nanos(0);
        let (a, b) = (ConnectionId(1), ConnectionId(2));
        let ends = if network.sealed {
            introduce(now, a, b, config)
        } else {
            [Connection::plaintext(now, a, b, config), Connection::plaintext(now, b, a, config)]
        };
        Self {
            now,
            ends,
            at: [address(1, 7400), address(2, 5000)],
            network,
            flying: BinaryHeap::new(),
            count: 0,
            sent: 0,
            bytes: [0; 2],
            longest: 0,
            in_burst: [false; 2],
            burst_losses: 0,
            astray: BTreeMap::new(),
            echo: None,
            deaf: false,
            asleep_until: now,
        }
    }

    fn lost_in_burst(&mut self, end: usize) -> bool {
        let turns = self.chance(if self.in_burst[end] { 250 } else { self.network.bursts });
        self.in_burst[end] ^= turns;
        let lost = self.in_burst[end] && self.chance(750);
        self.burst_losses += u64::from(lost);
        lost
    }

    fn awake(&self) -> Range<usize> {
        usize::from(self.now < self.asleep_until)..2
    }

    /// Splitmix64: the same network for the same seed.
    fn chance(&mut self, per_mille: u64) -> bool {
        self.network.seed = self.network.seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.network.seed;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) % 1000 < per_mille
    }

    pub(crate) fn transmit(&mut self) {
        let mut out = Vec::new();
        for end in self.awake() {
            while self.ends[end].poll_transmit(self.now, &mut out) {
                assert!(out.len() <= 1452, "{} bytes", out.len());
                let to = self.ends[end].remote().unwrap_or(self.at[1 - end]);
                self.send(end, to, &out);
            }
            while let Some(to) = self.ends[end].poll_excursion(self.now, &mut out) {
                assert!(out.len() <= MIN_DATAGRAM, "{} bytes", out.len());
                self.send(end, to, &out);
            }
        }
    }

    fn send(&mut self, end: usize, to: SocketAddr, packet: &[u8]) {
        self.bytes[end] += packet.len() as u64;
        self.sent += 1;
        self.longest = self.longest.max(packet.len());
        if let Some(echo) = self.echo.filter(|_| end == 1) {
            self.launch(echo, to, ONE_WAY / 2, packet.to_vec());
        }
        let copies = 1 + usize::from(self.chance(self.network.twice));
        for _ in 0..copies {
            let lost = self.lost_in_burst(end) || packet.len() > self.network.mtu;
            if self.chance(self.network.loss) || lost || self.deaf && end == 0 {
                continue;
            }
            let mut packet = packet.to_vec();
            if self.chance(self.network.broken) {
                let at = (self.count as usize * 7) % packet.len();
                packet[at] ^= 0x10;
            }
            let late = if self.chance(self.network.late) { ONE_WAY } else { Duration::ZERO };
            self.launch(self.at[end], to, ONE_WAY + late, packet);
        }
    }

    pub(crate) fn launch(&mut self, from: SocketAddr, to: SocketAddr, takes: Duration, packet: Vec<u8>) {
        self.count += 1;
        self.flying.push(Reverse((self.now.after(takes), self.count, from, to, packet)));
    }

    /// Advances to the next event, but not beyond `wake`.
    pub(crate) fn step_until(&mut self, wake: Instant, end: Instant) -> bool {
        if self.step(wake) {
            return true;
        }
        self.now = self.now.max(wake);
        wake < end
    }

    /// Advances to the next event; false if there is none before `end`.
    pub(crate) fn step(&mut self, end: Instant) -> bool {
        self.transmit();
        let arrival = self.flying.peek().map(|Reverse((at, ..))| *at);
        let timers = self.ends[self.awake()].iter().filter_map(Connection::poll_timeout);
        let wake = Some(self.asleep_until).filter(|at| *at > self.now);
        let Some(next) = timers.chain(arrival).chain(wake).min().filter(|next| *next <= end) else {
            return false;
        };
        self.now = self.now.max(next);
        while self.flying.peek().is_some_and(|Reverse((at, ..))| *at <= self.now) {
            let Some(Reverse((_, order, from, to, packet))) = self.flying.pop() else { break };
            match self.at.iter().position(|at| *at == to) {
                Some(end) if self.awake().contains(&end) => {
                    self.ends[end].handle_from(self.now, from, &packet);
                }
                Some(_) => self.flying.push(Reverse((self.asleep_until, order, from, to, packet))),
                None => *self.astray.entry(to).or_default() += packet.len(),
            }
        }
        for end in self.awake() {
            let end = &mut self.ends[end];
            if end.poll_timeout().is_some_and(|at| at <= self.now) {
                end.handle_timeout(self.now);
            }
        }
        true
    }
}
