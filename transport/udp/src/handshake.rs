//! The handshake: a cookie, then one Noise message each way.

use std::fmt;
use std::net::SocketAddr;
use std::time::Duration;

use snow::{Builder, HandshakeState};
use thiserror::Error;
use trimaran_net::Instant;
use zeroize::Zeroizing;

use crate::connection::{Config, Connection};
use crate::cookie::TokenKey;
use crate::keys::Keys;
use crate::packet::{ConnectionId, CookieBytes, MIN_DATAGRAM, Packet, TOKEN, VERSION};
use crate::reset::ResetKey;

/// The largest hello: a first packet has room for it, its cookie and its keys.
pub const MAX_HELLO: usize = 1024;

/// This many cookies are answered at once, within [`FLOOD`]: more than a listener sends for first packets
/// that were repeated. Of further ones the newest goes with the next first packet, so forged cookies cannot
/// make this side send without end.
const COOKIES: u8 = 4;
const FLOOD: Duration = Duration::from_millis(50);

/// The authentication of peers. Both sides need the same kind. Secrets are wiped from memory when dropped.
#[derive(Clone, PartialEq, Eq)]
pub enum Security {
    /// Both hold this key (`Noise_NNpsk0`), which makes a peer.
    PreShared(Zeroizing<[u8; 32]>),
    /// Each holds a key pair and knows the other's public key (`Noise_IK`, X25519).
    Pinned {
        /// The private key of this side.
        own: Zeroizing<[u8; 32]>,
        /// The public keys of peers: a listener admits all, the connecting side expects the first.
        peers: Vec<[u8; 32]>,
    },
    /// No encryption and no authentication: only for trusted networks, and only when asked for by this name.
    Plaintext,
}

impl Security {
    /// The key that no stranger has; nothing in the clear.
    fn secret(&self) -> &[u8] {
        match self {
            Self::PreShared(key) => &**key,
            Self::Pinned { own, .. } => &**own,
            Self::Plaintext => &[],
        }
    }
}

impl fmt::Debug for Security {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PreShared(_) => "PreShared",
            Self::Pinned { .. } => "Pinned",
            Self::Plaintext => "Plaintext",
        })
    }
}

/// Why no connection was made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum HandshakeError {
    /// The keys cannot be used.
    #[error(
        "the keys cannot be used: a pinned peer needs 32 bytes of a private key and one public key at least"
    )]
    Keys(#[source] snow::Error),
    /// No peer is pinned.
    #[error("no public key of a peer is pinned")]
    NoPeer,
    /// The hello is too long.
    #[error("a hello of {0} bytes is longer than {MAX_HELLO}")]
    Long(usize),
}

enum Half {
    Noise(Box<HandshakeState>),
    Plaintext,
}

const PSK: &str = "Noise_NNpsk0_25519_ChaChaPoly_BLAKE2s";
const PINNED: &str = "Noise_IK_25519_ChaChaPoly_BLAKE2s";

impl Half {
    /// The initiator's connection id is bound to the handshake: it cannot be changed on the path.
    fn new(security: &Security, initiator: ConnectionId, initiates: bool) -> Result<Self, HandshakeError> {
        let prologue = [b"trimaran/udp/4".as_slice(), &initiator.0.to_le_bytes()].concat();
        let build = |builder: Builder<'_>| {
            let builder = builder.prologue(&prologue)?;
            if initiates { builder.build_initiator() } else { builder.build_responder() }
        };
        let state = match security {
            Security::Plaintext => return Ok(Self::Plaintext),
            Security::PreShared(key) => {
                PSK.parse().and_then(|params| build(Builder::new(params).psk(0, key)?))
            }
            Security::Pinned { own, peers } => {
                let peer = peers.first().ok_or(HandshakeError::NoPeer)?;
                PINNED.parse().and_then(|params| {
                    let builder = Builder::new(params).local_private_key(&**own)?;
                    build(if initiates { builder.remote_public_key(peer)? } else { builder })
                })
            }
        };
        state.map(|state| Self::Noise(Box::new(state))).map_err(HandshakeError::Keys)
    }

    fn write(&mut self, payload: &[u8]) -> Result<Vec<u8>, snow::Error> {
        let Self::Noise(state) = self else { return Ok(payload.to_vec()) };
        let mut out = vec![0; payload.len() + 128];
        let length = state.write_message(payload, &mut out)?;
        out.truncate(length);
        Ok(out)
    }

    fn read(&mut self, message: &[u8]) -> Option<Vec<u8>> {
        let Self::Noise(state) = self else { return Some(message.to_vec()) };
        let mut out = vec![0; message.len()];
        let length = state.read_message(message, &mut out).ok()?;
        out.truncate(length);
        Some(out)
    }

    fn keys(self) -> Option<Keys> {
        let Self::Noise(state) = self else { return Some(Keys::Plaintext) };
        Some(Keys::Noise(Box::new(state.into_stateless_transport_mode().ok()?)))
    }
}

/// The connecting side before there is a connection. Send [`Connecting::initial`], and again whenever an
/// answer is overdue.
pub struct Connecting {
    here: ConnectionId,
    half: Half,
    message: Vec<u8>,
    /// The newest cookie: anyone on the path can forge one, so no earlier one keeps out the listener's.
    cookie: Option<CookieBytes>,
    /// When the first cookie came and was answered.
    asked: Option<Instant>,
    /// Since when cookies are counted, and how many since then were answered at once.
    flood: (Instant, u8),
    claimed: Option<u64>,
}

impl fmt::Debug for Connecting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Connecting").field("here", &self.here).finish_non_exhaustive()
    }
}

/// The effect of an answer.
#[derive(Debug)]
#[non_exhaustive]
pub enum Progress {
    /// None: it was invalid or forged.
    None(Connecting),
    /// Send [`Connecting::initial`] again at once: it holds a cookie.
    Retry(Connecting),
    /// The listener accepted the hello; this is its answer.
    Taken(Box<Connection>, Vec<u8>),
    /// The listener refused; this is its answer.
    Refused(Vec<u8>),
}

impl Connecting {
    /// Begins to connect; `here` is drawn at random, `hello` is for the listener.
    ///
    /// # Errors
    /// If the keys cannot be used or the hello is too long.
    pub fn new(security: &Security, here: ConnectionId, hello: &[u8]) -> Result<Self, HandshakeError> {
        if hello.len() > MAX_HELLO {
            return Err(HandshakeError::Long(hello.len()));
        }
        let mut half = Half::new(security, here, true)?;
        let message = half.write(hello).map_err(HandshakeError::Keys)?;
        let flood = (Instant::from_nanos(0), 0);
        Ok(Self { here, half, message, cookie: None, asked: None, flood, claimed: None })
    }

    /// Writes the first packet into `out`, which it replaces.
    pub fn initial(&self, out: &mut Vec<u8>) {
        let cookie = self.cookie.as_ref();
        Packet::Initial { version: VERSION, from: self.here, cookie, noise: &self.message }.write(out);
    }

    /// The listener's claimed version, if nobody answered in this one. Only a hint: anyone on the path can
    /// claim it.
    #[must_use]
    pub fn claimed_version(&self) -> Option<u64> {
        self.claimed.filter(|_| self.cookie.is_none())
    }

    /// Whether another cookie may be answered at once.
    fn may_answer(&mut self, now: Instant) -> bool {
        let (since, count) = &mut self.flood;
        if now.since(*since) >= FLOOD {
            (*since, *count) = (now, 0);
        }
        *count = count.saturating_add(1);
        *count <= COOKIES
    }

    /// Takes a datagram that claims to be from the listener.
    #[must_use]
    pub fn handle(mut self, now: Instant, datagram: &[u8], config: Config) -> Progress {
        match Packet::parse(datagram) {
            Ok(Packet::Retry { version, to, .. }) if to == self.here && version != VERSION => {
                self.claimed = Some(version);
                Progress::None(self)
            }
            Ok(Packet::Retry { to, cookie, .. })
                if to == self.here && self.cookie.as_ref() != Some(cookie) =>
            {
                self.cookie = Some(*cookie);
                self.asked.get_or_insert(now);
                if self.may_answer(now) { Progress::Retry(self) } else { Progress::None(self) }
            }
            Ok(Packet::Answer { version: VERSION, to, noise }) if to == self.here => {
                let payload = self.half.read(noise).unwrap_or_default();
                let Some((&[taken, ref there @ ..], rest)) = payload.split_first_chunk::<5>() else {
                    return Progress::None(self);
                };
                if taken == 0 {
                    return Progress::Refused(rest.to_vec());
                }
                let there = ConnectionId(u32::from_le_bytes(*there));
                let Some((token, rest)) = rest.split_first_chunk::<TOKEN>() else {
                    return Progress::None(self);
                };
                let Some(keys) = self.half.keys() else { return Progress::Refused(Vec::new()) };
                let mut connection = Connection::new(now, self.here, there, config, keys);
                connection.resets_with(*token);
                if let Some(asked) = self.asked {
                    connection.guess_round_trip(now.since(asked));
                }
                Progress::Taken(Box::new(connection), rest.to_vec())
            }
            _ => Progress::None(self),
        }
    }
}

/// The listening side: it keeps no state for peers before their address is validated.
pub struct Acceptor {
    security: Security,
    token_key: TokenKey,
    reset_key: ResetKey,
}

impl fmt::Debug for Acceptor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Acceptor").field("security", &self.security).finish_non_exhaustive()
    }
}

/// The first packet of a peer with a valid cookie and the right keys.
pub struct Initial {
    /// The id that its sender chose: with its address it tells a repeated packet from a second connection.
    pub from: ConnectionId,
    /// The hello.
    pub hello: Vec<u8>,
    /// The pinned key that its sender has proved to hold.
    pub key: Option<[u8; 32]>,
    half: Half,
    reset_key: ResetKey,
}

impl fmt::Debug for Initial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Initial").field("from", &self.from).finish_non_exhaustive()
    }
}

/// The reaction to a datagram for no connection.
#[derive(Debug)]
#[non_exhaustive]
pub enum Handled {
    /// Nothing.
    Ignore,
    /// Send the datagram in `out`. A reset is shorter than the datagram received, and a cookie is a third of
    /// it at most.
    Reply,
    /// Nothing: the address is valid, but the keys do not fit.
    Stranger,
    /// Judge the hello, then [`Initial::take`] or [`Initial::refuse`].
    Initial(Box<Initial>),
}

impl Acceptor {
    /// An acceptor with 32 random bytes as its secret. `port` is where it listens: after a restart with the
    /// same keys and port, peers of connections from before are told at once that these are gone.
    ///
    /// # Errors
    /// If the keys cannot be used.
    pub fn new(security: Security, secret: [u8; 32], port: u16) -> Result<Self, HandshakeError> {
        Half::new(&security, ConnectionId(0), false)?;
        let reset_key = ResetKey::new(security.secret(), port);
        Ok(Self { security, token_key: TokenKey::new(secret), reset_key })
    }

    /// Admits the holders of these public keys from now on, and no others, if peers are pinned. Connections
    /// that are there stay.
    pub fn pin(&mut self, keys: Vec<[u8; 32]>) {
        if let Security::Pinned { peers, .. } = &mut self.security {
            *peers = keys;
        }
    }

    /// Takes a datagram for no connection from `address`. Nothing is allocated before the cookie is
    /// validated.
    pub fn handle(&self, now: Instant, address: SocketAddr, datagram: &[u8], out: &mut Vec<u8>) -> Handled {
        if let Ok(Packet::Data { to, .. }) = Packet::parse(datagram) {
            Packet::Reset { unknown: to, token: &self.reset_key.token(to) }.write(out);
            // A reset is shorter than its cause: two listeners cannot keep each other busy.
            if out.len() < datagram.len() {
                return Handled::Reply;
            }
            out.clear();
            return Handled::Ignore;
        }
        let Some((from, noise)) = self.parse(now, address, datagram) else { return Handled::Ignore };
        let Some(noise) = noise else {
            let cookie = &self.token_key.issue(now, address, from);
            Packet::Retry { version: VERSION, to: from, cookie }.write(out);
            return Handled::Reply;
        };
        self.open(from, noise).map_or(Handled::Stranger, |initial| Handled::Initial(Box::new(initial)))
    }

    /// Whether `datagram` is a first packet with a valid cookie, which [`Acceptor::handle`] decrypts. Others
    /// it answers for nearly nothing.
    #[must_use]
    pub fn would_decrypt(&self, now: Instant, address: SocketAddr, datagram: &[u8]) -> bool {
        matches!(self.parse(now, address, datagram), Some((_, Some(_))))
    }

    /// The sender of a first packet, and the Noise message in it if its cookie is valid.
    fn parse<'a>(
        &self,
        now: Instant,
        address: SocketAddr,
        datagram: &'a [u8],
    ) -> Option<(ConnectionId, Option<&'a [u8]>)> {
        let Ok(Packet::Initial { version, from, cookie, noise }) = Packet::parse(datagram) else {
            return None;
        };
        let valid = |cookie| version == VERSION && self.token_key.accepts(now, address, from, cookie);
        // All first packets have the full length: a shorter one could get an answer larger than itself.
        (datagram.len() >= MIN_DATAGRAM).then_some((from, cookie.is_some_and(valid).then_some(noise)))
    }

    fn open(&self, from: ConnectionId, noise: &[u8]) -> Option<Initial> {
        let mut half = Half::new(&self.security, from, false).ok()?;
        let hello = half.read(noise)?;
        let key = match (&self.security, &half) {
            (Security::Pinned { peers, .. }, Half::Noise(state)) => {
                let theirs = state.get_remote_static()?;
                Some(*peers.iter().find(|peer| peer.as_slice() == theirs)?)
            }
            _ => None,
        };
        Some(Initial { from, hello, key, half, reset_key: self.reset_key.clone() })
    }
}

impl Initial {
    /// Accepts the peer: `here` is free and drawn at random, `answer` is for the peer. Writes the packet into
    /// `out`, which it replaces; keep it, and send it again whenever the same first packet comes again.
    #[must_use]
    pub fn take(
        mut self,
        now: Instant,
        here: ConnectionId,
        answer: &[u8],
        config: Config,
        out: &mut Vec<u8>,
    ) -> Option<Connection> {
        let token = self.reset_key.token(here);
        self.answer(1, here, &[&token, answer].concat(), out)?;
        let mut connection = Connection::new(now, here, self.from, config, self.half.keys()?);
        connection.on_answer(now);
        Some(connection)
    }

    /// Refuses the peer; `answer` says why. Writes the packet into `out`, which it replaces; no state needs
    /// to be kept.
    pub fn refuse(mut self, answer: &[u8], out: &mut Vec<u8>) {
        let _unsaid = self.answer(0, ConnectionId(0), answer, out);
    }

    fn answer(&mut self, taken: u8, here: ConnectionId, answer: &[u8], out: &mut Vec<u8>) -> Option<()> {
        let answer = answer.get(..(TOKEN + MAX_HELLO).min(answer.len()))?;
        let payload = [&[taken][..], &here.0.to_le_bytes(), answer].concat();
        let noise = &self.half.write(&payload).ok()?;
        Packet::Answer { version: VERSION, to: self.from, noise }.write(out);
        Some(())
    }
}
