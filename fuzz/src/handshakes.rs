//! Properties of two peers that shake hands while a stranger without their keys sees, repeats, changes
//! and sends whatever it likes. The fuzz target searches for packets that break it; an ordinary test of
//! `trimaran-udp` replays the corpus.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

use trimaran_net::Instant;
use trimaran_udp::{
    Acceptor, Connecting, Connection, ConnectionId, Handled, MIN_DATAGRAM, Progress, Security, VERSION,
    destination,
};

use crate::wire::config;

const HERE: ConnectionId = ConnectionId(10);
/// Where the side that connects is, and where the stranger is.
const HOME: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::new(192, 0, 2, 2)), 4000);
const ELSEWHERE: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::new(192, 0, 2, 1)), 4000);
/// So many cookies are sent back at once, and once more in each further time that long.
const COOKIES: u64 = 4;
const FLOOD: Duration = Duration::from_millis(50);

/// The first byte chooses the keys; each further few bytes are something that happens: a packet of one of the
/// two is delivered or lost, time passes, or the stranger sends something. Then the stranger falls silent,
/// and the two must come together.
pub fn handshakes(bytes: &[u8]) {
    let mut reader = bytes.iter().copied();
    let security = match reader.next().unwrap_or_default() % 2 {
        0 => Security::PreShared([9; 32].into()),
        _ => pinned(),
    };
    let Some(mut street) = Street::new(&security) else { unreachable!("the keys are good") };
    while let Some(what) = reader.next() {
        street.happens(what, &mut || reader.next().unwrap_or_default());
    }
    street.come_together();
}

/// Both sides with one pair of keys: who is who is not in question here.
fn pinned() -> Security {
    // The public key of the private key of 32 bytes 9 (RFC 7748).
    const PUBLIC: [u8; 32] = [
        0x57, 0xdb, 0x4b, 0x35, 0x9f, 0x23, 0xae, 0x5e, 0x14, 0x6e, 0x4e, 0x25, 0x12, 0x05, 0x67, 0x04, 0x72,
        0x25, 0x06, 0x34, 0x8c, 0x15, 0x0c, 0x14, 0x75, 0x3d, 0x0c, 0x93, 0x3d, 0x04, 0xd4, 0x21,
    ];
    Security::Pinned { own: [9; 32].into(), peers: vec![PUBLIC] }
}

/// Two peers, and what is between them.
struct Street {
    now: Instant,
    begun: Instant,
    acceptor: Acceptor,
    connecting: Option<Connecting>,
    connected: Option<Connection>,
    /// By callers, as a listener keeps them: the answer, and the connection.
    guests: BTreeMap<(SocketAddr, ConnectionId), (Vec<u8>, Connection)>,
    /// Under way to the listener, and to the side that connects.
    inwards: Vec<Vec<u8>>,
    outwards: Vec<Vec<u8>>,
    /// Everything that was ever sent, for the stranger to repeat.
    seen: Vec<Vec<u8>>,
    /// Bytes that the listener had from an address and sent there.
    had: BTreeMap<SocketAddr, (usize, usize)>,
    /// Cookies that were sent back at once.
    at_once: u64,
}

impl Street {
    fn new(security: &Security) -> Option<Self> {
        let now = Instant::from_nanos(1_000_000_000);
        Some(Self {
            now,
            begun: now,
            acceptor: Acceptor::new(security.clone(), [7; 32], 7400).ok()?,
            connecting: Some(Connecting::new(security, HERE, b"hello").ok()?),
            connected: None,
            guests: BTreeMap::new(),
            inwards: Vec::new(),
            outwards: Vec::new(),
            seen: Vec::new(),
            had: BTreeMap::new(),
            at_once: 0,
        })
    }

    fn happens(&mut self, what: u8, next: &mut impl FnMut() -> u8) {
        match what % 12 {
            0 => self.ask(),
            1 if !self.inwards.is_empty() => {
                let packet = self.inwards.remove(0);
                self.listener_gets(HOME, &packet);
            }
            2 if !self.outwards.is_empty() => {
                let packet = self.outwards.remove(0);
                self.connector_gets(&packet);
            }
            3 => drop(self.inwards.pop()),
            4 => drop(self.outwards.pop()),
            5 => self.now = self.now.after(Duration::from_millis(u64::from(next()) * 10)),
            // Something that was seen, as it is or with a byte changed.
            6..=8 => {
                let Some(mut packet) = self.seen.get(usize::from(next())).cloned() else { return };
                let (at, change) = (usize::from(next()) * 5, next());
                if let Some(byte) = packet.get_mut(at) {
                    *byte ^= change;
                }
                self.strange(what, &packet);
            }
            // A retry or an answer to the right id, of any version.
            9 | 10 => {
                let (form, version) = (2 + u64::from(what % 2), VERSION - 1 + u64::from(next() % 3));
                let length = if form == 2 { 24 } else { 32 + usize::from(next()) };
                let inside = (0..length).map(|_| next()).collect::<Vec<u8>>();
                let packet =
                    [&(version << 2 | form).to_le_bytes()[..], &HERE.0.to_le_bytes(), &inside].concat();
                self.connector_gets(&packet);
            }
            // Anything.
            _ => {
                let mut packet: Vec<u8> = (0..next()).map(|_| next()).collect();
                if what >= 128 {
                    packet.resize(MIN_DATAGRAM, 0);
                }
                self.strange(what, &packet);
            }
        }
    }

    /// The stranger sends a packet: to the side that connects, or to the listener, from where it is or as if
    /// from elsewhere.
    fn strange(&mut self, what: u8, packet: &[u8]) {
        match what / 12 % 3 {
            0 => self.connector_gets(packet),
            1 => self.listener_gets(HOME, packet),
            _ => self.listener_gets(ELSEWHERE, packet),
        }
    }

    /// The side that connects sends its first packet, as its clock says.
    fn ask(&mut self) {
        if let Some(connecting) = &self.connecting {
            let mut out = Vec::new();
            connecting.initial(&mut out);
            assert_eq!(out.len(), MIN_DATAGRAM);
            self.seen.push(out.clone());
            self.inwards.push(out);
        }
    }

    fn listener_gets(&mut self, from: SocketAddr, packet: &[u8]) {
        let (had, sent) = self.had.entry(from).or_default();
        *had += packet.len();
        // As a listener does it: the acceptor sees packets of no connection that is there.
        if let Some(id) = destination(packet)
            && let Some((_, guest)) = self.guests.values_mut().find(|(_, guest)| guest.id() == id)
        {
            guest.handle(self.now, packet);
            return;
        }
        let mut reply = Vec::new();
        match self.acceptor.handle(self.now, from, packet, &mut reply) {
            // A reset, for a packet of a connection that is not there.
            Handled::Reply if destination(packet).is_some() => assert!(reply.len() < packet.len()),
            Handled::Reply => assert!(reply.len() * 3 <= packet.len()),
            Handled::Initial(initial) => {
                let caller = (from, initial.from);
                assert_eq!(initial.from, HERE, "the stranger has no keys");
                if let Some((answer, _)) = self.guests.get(&caller) {
                    reply.clone_from(answer);
                } else {
                    let name = ConnectionId(20 + self.guests.len() as u32);
                    let guest = initial.take(self.now, name, b"welcome", config(), &mut reply);
                    let Some(guest) = guest else { unreachable!("who knocks rightly is let in") };
                    self.guests.insert(caller, (reply.clone(), guest));
                }
            }
            _ => {}
        }
        *sent += reply.len();
        assert!(*sent <= 3 * *had, "{sent} bytes for {had}");
        assert!(
            self.guests.len() <= 2,
            "one for each address that somebody has repeated the first packet from"
        );
        if !reply.is_empty() {
            self.seen.push(reply.clone());
            if from == HOME {
                self.outwards.push(reply);
            }
        }
    }

    fn connector_gets(&mut self, packet: &[u8]) {
        if let Some(connected) = &mut self.connected {
            connected.handle(self.now, packet);
            return;
        }
        let Some(connecting) = self.connecting.take() else { return };
        match connecting.handle(self.now, packet, config()) {
            Progress::None(connecting) => self.connecting = Some(connecting),
            Progress::Retry(connecting) => {
                self.connecting = Some(connecting);
                self.at_once += 1;
                let spans = self.now.since(self.begun).as_nanos() / FLOOD.as_nanos() + 1;
                assert!(u128::from(self.at_once) <= u128::from(COOKIES) * spans, "{}", self.at_once);
                self.ask();
            }
            Progress::Taken(connected, said) => {
                assert_eq!(said, b"welcome");
                self.connected = Some(*connected);
            }
            other => unreachable!("nobody refused: {other:?}"),
        }
    }

    /// Nobody disturbs any more: within a few tries there is a connection, and the listener hears it use its
    /// keys.
    fn come_together(&mut self) {
        for _ in 0..4 {
            self.now = self.now.after(2 * FLOOD);
            self.ask();
            while !self.inwards.is_empty() || !self.outwards.is_empty() {
                for packet in std::mem::take(&mut self.inwards) {
                    self.listener_gets(HOME, &packet);
                }
                for packet in std::mem::take(&mut self.outwards) {
                    self.connector_gets(&packet);
                }
            }
        }
        let Some(connected) = &mut self.connected else { unreachable!("{:?}", self.connecting) };
        connected.ping();
        let mut out = Vec::new();
        assert!(connected.poll_transmit(self.now, &mut out));
        let before = self.guests.values().filter(|(_, guest)| guest.is_confirmed()).count();
        assert_eq!(before, 0, "nobody else can use the keys");
        self.listener_gets(HOME, &out);
        let confirmed = self.guests.values().filter(|(_, guest)| guest.is_confirmed()).count();
        assert_eq!(confirmed, 1);
    }
}
