//! Connecting over datagrams.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use bytes::{BufMut, BytesMut};
use trimaran_udp::{Config, Connecting, Connection, ConnectionId, Progress, Security, VERSION};
use trimaran_wire::{Accept, Decoder, Format, HEADER_BYTES, Lane, Message};

use super::Udp;
use super::driver::Connections;
use super::port::Port;
use super::socket::{Incoming, Outgoing, Path};
use crate::handshake::HandshakeError;
use crate::keys::{NoiseKey, PeerKey};
use crate::lane_transport::Introduction;
use crate::parts::LinkParts;
use crate::stats::Counters;
use crate::transport::AttemptError;
use trimaran_net::{Instant, Net, UdpSocket, random_bytes, until};

/// The pause before the first packet is sent again; it doubles up to [`LAST_PAUSE`].
const FIRST_PAUSE: Duration = Duration::from_millis(50);
/// The longest pause between two first packets: a listener that has just started is found within that time.
const LAST_PAUSE: Duration = Duration::from_millis(200);
/// An address tried in vain leaves this part of its time, so that the cause is known before the attempt is
/// cut short.
const REST: u32 = 50;

/// Tries each address of the host, each for its share of the handshake's time limit: a missing listener sends
/// no error.
pub(super) async fn attempt(
    net: &Arc<dyn Net>,
    udp: &Udp,
    introduction: &Introduction<'_>,
) -> Result<LinkParts, AttemptError> {
    let addresses = net.resolve(&udp.at.at.to_string()).await.map_err(AttemptError::Resolve)?;
    let count = u32::try_from(addresses.len()).unwrap_or(u32::MAX);
    let mut last = AttemptError::NoAddress;
    for (to, others) in addresses.into_iter().zip((0..count).rev()) {
        let share = introduction.by.since(net.now()) / (others + 1);
        let by = net.now().after(share - share / REST);
        match introduce(net, to, udp, introduction, by).await {
            Ok(parts) => return Ok(parts),
            Err(e) if e.is_about_one_address() => last = e,
            Err(e) => return Err(e),
        }
    }
    Err(last)
}

impl AttemptError {
    /// Whether another address of the host may be better.
    const fn is_about_one_address(&self) -> bool {
        matches!(
            self,
            Self::Connect { .. }
                | Self::Handshake { cause: HandshakeError::Unanswered | HandshakeError::Datagram { .. }, .. }
        )
    }
}

async fn introduce(
    net: &Arc<dyn Net>,
    to: SocketAddr,
    Udp { at, options, security }: &Udp,
    introduction: &Introduction<'_>,
    by: Instant,
) -> Result<LinkParts, AttemptError> {
    let Introduction { application, session, link, .. } = *introduction;
    let failed = |cause| AttemptError::Handshake { address: to.to_string(), cause };
    let candidates = options.trust.connecting(security.as_ref()).map_err(failed)?;
    let here: SocketAddr = match to {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let refused = |cause| AttemptError::Connect { address: to.to_string(), cause };
    let socket = net.bind_udp(here, options.socket).map_err(refused)?;
    let counters = Counters::unframed();
    let format = application.format();
    let config = options.config(at.mode, link, format);
    let hello = introduce_with(&Message::Hello(introduction.hello(Lane::Frames)), &config, &counters);
    let mut ways = Vec::new();
    for candidate in candidates {
        let name = ConnectionId(net.random().map_err(refused)? as u32);
        let connecting = Connecting::new(&candidate, name, &hello).map_err(|e| failed(e.into()))?;
        ways.push((key_of(&candidate), connecting));
    }
    let mut asking = Asking { net, socket: &socket, to, incoming: Incoming::new(&socket) };
    let (key, mut connection, answer) = asking.ask(ways, config, by).await.map_err(failed)?;
    let (accept, reliable) = read_answer(&answer, format, &counters).map_err(failed)?;
    let theirs = introduction.recognize(&accept).map_err(failed)?;
    connection.set_idle_timeout(link.agreed(accept.idle_timeout));
    let reliable = reliable && config.frame_deadline.is_none();
    let batching = theirs.batching.unwrap_or(link.batching);
    connection.set_batch(batching.size);
    connection.set_coded(batching.coded);
    connection.follow(to, random_bytes(&**net).map_err(refused)?);
    // The listener admits this side once it has seen it use its keys.
    connection.ping();

    let connections = Connections::new(net);
    let here = connection.id();
    let port = Port::new(net, &socket, Path::to(to), connection);
    net.spawn(Box::pin(connections.serve(here, &port)));
    let mut incoming = asking.incoming;
    let own = Arc::clone(&port);
    net.spawn(Box::pin(async move {
        // A reset bears the listener's id. The connection is the only one at this socket.
        let reset = |path: Path, datagram: &[u8]| {
            let now = own.net.now();
            own.handle(now, path.remote, datagram);
            own.settle(now);
        };
        let mut emptied = pin!(connections.emptied());
        loop {
            tokio::select! {
                biased;
                () = &mut emptied => break,
                () = connections.receive(&mut incoming, reset) => {}
            }
        }
    }));
    port.settle(net.now());
    let judged = match (key, security) {
        (Some(key), Some(security)) => security.judge(key, theirs.role.as_deref()),
        _ => Ok(()),
    };
    let link = (session, reliable, format.channels);
    let parts = super::parts::parts(&port, options.is_encrypted(), theirs, link, counters);
    Ok(LinkParts { doubt: judged.err().map(HandshakeError::from), ..parts })
}

/// The key of the listener that answers to `security`.
fn key_of(security: &Security) -> Option<PeerKey> {
    match security {
        Security::Pinned { peers, .. } => peers.first().map(|peer| PeerKey::Udp(NoiseKey::from_bytes(*peer))),
        _ => None,
    }
}

/// A handshake payload: the message, and whether all frames sent from here will be complete. Counted as sent.
pub(super) fn introduce_with(message: &Message, config: &Config, counters: &Counters) -> BytesMut {
    let mut bytes = BytesMut::new();
    message.encode(&mut bytes);
    counters.sent.count(message.kind(), bytes.len() - HEADER_BYTES);
    bytes.put_u8(u8::from(config.frame_deadline.is_some()));
    bytes
}

/// Reads a handshake payload. Counted as received.
pub(super) fn read_introduction(
    bytes: &[u8],
    format: Format,
    counters: &Counters,
) -> Result<(Message, bool), HandshakeError> {
    let (message, reliable) = match bytes.split_last() {
        Some((mode, message)) => (message, *mode == 0),
        None => return Err(HandshakeError::Closed),
    };
    let mut decoder = Decoder::new(format);
    decoder.push(message);
    let length = message.len().saturating_sub(HEADER_BYTES);
    let message = decoder.next_message()?.ok_or(HandshakeError::Closed)?;
    counters.received.count(message.kind(), length);
    Ok((message, reliable))
}

fn read_answer(bytes: &[u8], format: Format, counters: &Counters) -> Result<(Accept, bool), HandshakeError> {
    match read_introduction(bytes, format, counters)? {
        (Message::Accept(accept), reliable) => Ok((accept, reliable)),
        (Message::Refuse(refusal), _) => Err(HandshakeError::Refused(refusal)),
        (other, _) => Err(HandshakeError::Unexpected { kind: other.kind() }),
    }
}

/// A socket that waits for an answer.
struct Asking<'a> {
    net: &'a Arc<dyn Net>,
    socket: &'a Arc<dyn UdpSocket>,
    to: SocketAddr,
    incoming: Incoming,
}

/// The state of one kind of handshake.
enum Stage {
    Asking(Connecting),
    /// A packet must be sent at once.
    Again(Connecting),
    Taken(Box<Connection>, Vec<u8>),
    Refused(Vec<u8>),
}

impl Asking<'_> {
    /// Sends first packets until one is answered, or until `by`. Returns the listener's key, the connection
    /// and the listener's answer.
    async fn ask(
        &mut self,
        ways: Vec<(Option<PeerKey>, Connecting)>,
        config: Config,
        by: Instant,
    ) -> Result<(Option<PeerKey>, Connection, Vec<u8>), HandshakeError> {
        let mut stages: Vec<_> = ways.into_iter().map(|(key, way)| (key, Stage::Asking(way))).collect();
        let (mut again, mut pause) = (self.net.now(), FIRST_PAUSE);
        loop {
            let all = self.net.now() >= again;
            if all {
                again = self.net.now().after(pause);
                pause = (pause * 2).min(LAST_PAUSE);
            }
            let mut waiting = Vec::new();
            for (key, stage) in stages {
                let stage = match stage {
                    Stage::Again(connecting) => self.send(connecting),
                    Stage::Asking(connecting) if all => self.send(connecting),
                    Stage::Asking(connecting) => Stage::Asking(connecting),
                    Stage::Taken(connection, answer) => return Ok((key, *connection, answer)),
                    Stage::Refused(answer) => return Err(refusal(&answer, config.format)),
                };
                waiting.push((key, stage));
            }
            stages = waiting;
            if self.net.now() >= by {
                return Err(in_vain(&stages));
            }
            let Self { net, to, incoming, .. } = self;
            let received = incoming.receive(|path, datagram| {
                if path.remote == *to {
                    let all = std::mem::take(&mut stages);
                    let take = |(key, stage): (_, Stage)| (key, stage.take(&***net, datagram, config));
                    stages = all.into_iter().map(take).collect();
                }
            });
            if let Some(received) = until(&***net, again.min(by), received).await {
                received.map_err(HandshakeError::Io)?;
            }
        }
    }

    /// A packet that cannot be sent counts as lost: it is sent again.
    fn send(&self, connecting: Connecting) -> Stage {
        let mut datagram = Vec::new();
        connecting.initial(&mut datagram);
        let mut outgoing = Outgoing::new(Path::to(self.to), &**self.socket);
        outgoing.push(&datagram);
        outgoing.send(&**self.socket);
        Stage::Asking(connecting)
    }
}

/// Why there was no answer, as far as known.
fn in_vain(stages: &[(Option<PeerKey>, Stage)]) -> HandshakeError {
    let claimed = stages.iter().find_map(|(_, stage)| match stage {
        Stage::Asking(connecting) | Stage::Again(connecting) => connecting.claimed_version(),
        _ => None,
    });
    match claimed {
        Some(theirs) => HandshakeError::Datagram { theirs, ours: VERSION },
        None => HandshakeError::Unanswered,
    }
}

/// The error for a listener's refusal.
fn refusal(answer: &[u8], format: Format) -> HandshakeError {
    read_answer(answer, format, &Counters::unframed()).err().unwrap_or(HandshakeError::Closed)
}

impl Stage {
    fn take(self, net: &dyn Net, datagram: &[u8], config: Config) -> Self {
        let now = net.now();
        match self {
            Self::Asking(connecting) => match connecting.handle(now, datagram, config) {
                Progress::Retry(connecting) => Self::Again(connecting),
                Progress::Taken(connection, answer) => Self::Taken(connection, answer),
                Progress::Refused(answer) => Self::Refused(answer),
                Progress::None(connecting) => Self::Asking(connecting),
                _ => Self::Refused(Vec::new()),
            },
            Self::Taken(mut connection, answer) => {
                // Data may come right behind the answer.
                connection.handle(now, datagram);
                Self::Taken(connection, answer)
            }
            other => other,
        }
    }
}

impl From<trimaran_udp::HandshakeError> for HandshakeError {
    fn from(error: trimaran_udp::HandshakeError) -> Self {
        Self::Io(io::Error::other(error))
    }
}
