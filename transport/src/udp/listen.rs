//! Listening over datagrams: admission of peers, and limits for strangers.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;

use trimaran_udp::{Acceptor as UdpAcceptor, Config, ConnectionId, Handled, Initial};
use trimaran_wire::{Batching, DecodeFault, Hello, Lane, Message, Refusal};

use super::Udp;
use super::connect::{introduce_with, read_introduction};
use super::driver::Connections;
use super::options::pinned;
use super::port::{Port, Waiter};
use super::socket::{Incoming, Outgoing, Path};
use crate::acceptor::Acceptor;
use crate::handshake::HandshakeError;
use crate::keys::{KnownPeer, NoiseKey, PeerKey, Security};
use crate::peer::Peer;
use crate::pending::Slot;
use crate::stats::Counters;
use crate::watched_socket::WatchedSocket;
use crate::{PeerAddress, UdpEndpoint};
use trimaran_net::{UdpSocket, random_bytes, until};

/// Listens, and receives peers until nobody accepts any more. Returns the address.
pub(super) fn listen(
    at: SocketAddr,
    Udp { at: UdpEndpoint { mode, .. }, options, security }: &Udp,
    acceptor: &Arc<Acceptor>,
) -> io::Result<SocketAddr> {
    let noise = options.trust.listening(security.as_ref()).map_err(io::Error::other)?;
    let socket = acceptor.net.bind_udp(at, options.socket)?;
    let socket: Arc<dyn UdpSocket> = WatchedSocket::new(socket, Some(acceptor.serving()));
    let address = socket.local_addr()?;
    let secret = random_bytes(&*acceptor.net)?;
    let udp = UdpAcceptor::new(noise, secret, address.port()).map_err(io::Error::other)?;
    let connections = Connections::new(&acceptor.net);
    let config = options.config(*mode, &acceptor.link, acceptor.application.format());
    let listener = UdpListener {
        acceptor: Arc::clone(acceptor),
        config,
        security: security.clone(),
        encrypted: options.is_encrypted(),
        pinned: Mutex::new(Pinned { udp, peers: known(security.as_ref()) }),
        socket,
        connections,
        answers: Arc::default(),
    };
    acceptor.net.spawn(Box::pin(listener.serve()));
    Ok(address)
}

/// The address of a peer and its id for the connection.
type Caller = (SocketAddr, ConnectionId);

/// A listening socket, and the connections at it.
struct UdpListener {
    acceptor: Arc<Acceptor>,
    config: Config,
    security: Option<Security>,
    encrypted: bool,
    pinned: Mutex<Pinned>,
    socket: Arc<dyn UdpSocket>,
    connections: Arc<Connections>,
    /// Answers to callers: a repeated first packet means the same connection.
    answers: Arc<Mutex<BTreeMap<Caller, Vec<u8>>>>,
}

/// The handshakes, and the peers whose keys they admit.
struct Pinned {
    udp: UdpAcceptor,
    peers: Arc<[KnownPeer]>,
}

impl Pinned {
    /// The handshakes with the peers that are known now.
    fn now(&mut self, security: Option<&Security>) -> &UdpAcceptor {
        let peers = known(security);
        if !Arc::ptr_eq(&peers, &self.peers) {
            self.udp.pin(pinned(&peers));
            self.peers = peers;
        }
        &self.udp
    }
}

fn known(security: Option<&Security>) -> Arc<[KnownPeer]> {
    security.map_or_else(Arc::default, |security| security.peers.now())
}

/// A caller with valid keys.
struct Guest {
    hello: Hello,
    peer: Peer,
    /// How items travel.
    batching: Batching,
    /// Whether all frames will be complete, in both directions.
    reliable: bool,
    counters: Arc<Counters>,
}

impl UdpListener {
    async fn serve(self) {
        let mut incoming = Incoming::new(&self.socket);
        let mut closed = pin!(self.acceptor.closed());
        loop {
            tokio::select! {
                biased;
                () = &mut closed => break,
                () = self.connections.receive(&mut incoming, |path, datagram| self.take(path, datagram)) => {}
            }
        }
        let mut emptied = pin!(self.connections.emptied());
        loop {
            tokio::select! {
                biased;
                () = &mut emptied => break,
                () = self.connections.receive(&mut incoming, |_, _| {}) => {}
            }
        }
    }

    /// A datagram for no connection.
    fn take(&self, path: Path, datagram: &[u8]) {
        let from = path.remote;
        let mut pinned = self.pinned.lock();
        let udp = pinned.now(self.security.as_ref());
        // A validated address costs work from here on.
        if udp.would_decrypt(self.acceptor.net.now(), from, datagram)
            && let Err(e) = self.acceptor.begin(&PeerAddress::Udp(from))
        {
            return self.acceptor.failed(&from, e);
        }
        let mut reply = Vec::new();
        let handled = udp.handle(self.acceptor.net.now(), from, datagram, &mut reply);
        drop(pinned);
        match handled {
            Handled::Reply => self.send(path, &reply),
            Handled::Initial(initial) => self.answer(path, *initial),
            Handled::Stranger => self.acceptor.failed(&from, HandshakeError::Stranger),
            _ => {}
        }
    }

    fn answer(&self, path: Path, initial: Initial) {
        let from = path.remote;
        let caller = (from, initial.from);
        if let Some(answer) = self.answers.lock().get(&caller) {
            return self.send(path, answer);
        }
        let mut reply = Vec::new();
        match self.judge(&initial) {
            Ok(guest) => match self.let_in(path, initial, guest, &mut reply) {
                Ok(()) => {}
                Err(e) => return self.acceptor.failed(&from, HandshakeError::Io(e)),
            },
            Err(error) => {
                if let Some(refusal) = error.refusal() {
                    let answer =
                        introduce_with(&Message::Refuse(refusal), &self.config, &Counters::unframed());
                    initial.refuse(&answer, &mut reply);
                }
                self.acceptor.failed(&from, error);
            }
        }
        self.send(path, &reply);
    }

    /// Whether the caller is admitted.
    fn judge(&self, initial: &Initial) -> Result<Guest, HandshakeError> {
        let counters = Counters::unframed();
        let (hello, reliable) = match read_introduction(&initial.hello, self.config.format, &counters) {
            Ok((Message::Hello(hello), reliable)) => Ok((hello, reliable)),
            Ok((other, _)) => Err(HandshakeError::Unexpected { kind: other.kind() }),
            Err(HandshakeError::Decode(e)) => Err(match e.fault {
                DecodeFault::Version { ours, theirs } => {
                    HandshakeError::Refused(Refusal::Version { listener: ours, connector: theirs })
                }
                _ => HandshakeError::Decode(e),
            }),
            Err(e) => Err(e),
        }?;
        if hello.lane != Lane::Frames {
            let Hello { session, lane, .. } = hello;
            return Err(HandshakeError::Refused(Refusal::Session { session, lane }));
        }
        let peer = self.acceptor.identify(&hello)?;
        if let (Some(key), Some(security)) = (initial.key, &self.security) {
            security.judge(PeerKey::Udp(NoiseKey::from_bytes(key)), peer.role.as_deref())?;
        }
        // It takes a place only once it has proved to be there now.
        self.acceptor.admits(&hello).map_err(HandshakeError::Refused)?;
        let reliable = reliable && self.config.frame_deadline.is_none();
        let batching = peer.batching.unwrap_or(self.acceptor.link.batching);
        Ok(Guest { hello, peer, batching, reliable, counters })
    }

    /// Makes a connection for the caller, and a link once it has proved to be there now: its first packet may
    /// be a copy sent by somebody else.
    fn let_in(&self, path: Path, initial: Initial, guest: Guest, reply: &mut Vec<u8>) -> io::Result<()> {
        let (acceptor, caller) = (&self.acceptor, (path.remote, initial.from));
        let here = self.free_name()?;
        let accept = Message::Accept(acceptor.answer(&guest.peer));
        let answer = introduce_with(&accept, &self.config, &guest.counters);
        let Batching { size: batch, coded } = guest.batching;
        let idle_timeout = acceptor.link.agreed(guest.hello.idle_timeout);
        let config = Config { batch, coded, idle_timeout, ..self.config };
        let mut connection = initial
            .take(acceptor.net.now(), here, &answer, config, reply)
            .ok_or_else(|| io::Error::other("the answer could not be sealed"))?;
        connection.follow(caller.0, random_bytes(&*acceptor.net)?);
        self.answers.lock().insert(caller, reply.clone());
        let port = Port::new(&acceptor.net, &self.socket, path, connection);
        let (served, answers) = (self.connections.serve(here, &port), Arc::clone(&self.answers));
        acceptor.net.spawn(Box::pin(async move {
            served.await;
            answers.lock().remove(&caller);
        }));
        let slot = acceptor.slot(&PeerAddress::Udp(caller.0));
        acceptor.net.spawn(Box::pin(greet(Arc::clone(acceptor), port, guest, slot, self.encrypted)));
        Ok(())
    }

    /// A connection id that is free here.
    fn free_name(&self) -> io::Result<ConnectionId> {
        loop {
            let id = ConnectionId(self.acceptor.net.random()? as u32);
            if !self.connections.has(id) {
                return Ok(id);
            }
        }
    }

    /// A packet that cannot be sent counts as lost: the caller asks again.
    fn send(&self, path: Path, datagram: &[u8]) {
        if !datagram.is_empty() {
            let mut outgoing = Outgoing::new(path, &*self.socket);
            outgoing.push(datagram);
            outgoing.send(&*self.socket);
        }
    }
}

/// Hands out the link with a guest once it has used its keys, or drops it.
async fn greet(acceptor: Arc<Acceptor>, port: Arc<Port>, guest: Guest, mut slot: Slot, encrypted: bool) {
    let confirmed = poll_fn(|cx| {
        let mut state = port.lock();
        if state.connection.is_confirmed() || state.connection.closed().is_some() {
            return Poll::Ready(state.connection.is_confirmed());
        }
        state.wait(Waiter::Greeter, cx);
        Poll::Pending
    });
    let by = acceptor.net.now().after(acceptor.link.handshake_timeout);
    let confirmed = tokio::select! {
        biased;
        confirmed = until(&*acceptor.net, by, confirmed) => match confirmed {
            Some(true) => Ok(()),
            _ => Err(HandshakeError::TimedOut),
        },
        () = slot.revoked() => Err(HandshakeError::Refused(Refusal::Busy)),
    };
    drop(slot);
    let Guest { hello, reliable, counters, .. } = guest;
    let entered = confirmed.and_then(|()| acceptor.enter(&hello).map_err(HandshakeError::Refused));
    let (peer, place) = match entered {
        Ok(entered) => entered,
        Err(error) => {
            port.lock().connection.close();
            port.settle(acceptor.net.now());
            return acceptor.failed(&port.remote(), error);
        }
    };
    let link = (hello.session, reliable, acceptor.application.format().channels);
    let parts = super::parts::parts(&port, encrypted, peer, link, counters);
    acceptor.hand_out(parts.holding(place)).await;
}
