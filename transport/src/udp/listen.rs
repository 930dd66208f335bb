//! Listening over datagrams: who is let in, and what strangers may cost.

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::task::Poll;

use trimaran_udp::{Config, ConnectionId, Door, Knock, Reception};
use trimaran_wire::{Accept, Batching, DecodeFault, Hello, Lane, Message, Refusal};

use super::connect::{introduce_with, read_introduction};
use super::driver::Board;
use super::port::{Port, Waiter};
use super::socket::{Incoming, Outgoing, Path};
use crate::desk::{Desk, lock};
use crate::handshake::HandshakeError;
use crate::keys::{NoiseKey, PeerKey};
use crate::pending::Slot;
use crate::stats::Counters;
use crate::{PeerAddress, UdpMode};
use trimaran_net::{UdpSocket, random_bytes, until};

/// Listens, and receives peers until nobody accepts them any more. Says where.
pub(super) fn listen(at: SocketAddr, mode: Option<UdpMode>, desk: &Arc<Desk>) -> io::Result<SocketAddr> {
    let options = &desk.options.udp;
    let security = options.trust.listening(desk.options.security.as_ref()).map_err(io::Error::other)?;
    let door = Door::new(security, random_bytes(&*desk.net)?).map_err(io::Error::other)?;
    let socket = desk.net.bind_udp(at, options.socket)?;
    let address = socket.local_addr()?;
    let board = Board::new(&desk.net);
    let config = options.config(mode, &desk.options.link, desk.application.format());
    let hall = Hall { desk: Arc::clone(desk), config, door, socket, board, answers: Arc::default() };
    desk.net.spawn(Box::pin(hall.serve()));
    Ok(address)
}

/// The address of a peer and the name that it gave its connection.
type Caller = (SocketAddr, ConnectionId);

/// A listening socket, and the connections at it.
struct Hall {
    desk: Arc<Desk>,
    config: Config,
    door: Door,
    socket: Arc<dyn UdpSocket>,
    board: Arc<Board>,
    /// What callers were answered: the same first packet may come again, and means the same connection.
    answers: Arc<Mutex<BTreeMap<Caller, Vec<u8>>>>,
}

/// A caller whose keys fit.
struct Guest {
    hello: Hello,
    /// How items travel.
    batching: Batching,
    /// Whether all frames will be whole, in both directions.
    reliable: bool,
    counters: Arc<Counters>,
}

impl Hall {
    async fn serve(self) {
        let mut incoming = Incoming::new(&self.socket);
        let mut closed = pin!(self.desk.closed());
        loop {
            tokio::select! {
                biased;
                () = &mut closed => break,
                () = self.board.receive(&mut incoming, |path, datagram| self.take(path, datagram)) => {}
            }
        }
        let mut emptied = pin!(self.board.emptied());
        loop {
            tokio::select! {
                biased;
                () = &mut emptied => break,
                () = self.board.receive(&mut incoming, |_, _| {}) => {}
            }
        }
    }

    /// A datagram for no connection.
    fn take(&self, path: Path, datagram: &[u8]) {
        let from = path.remote;
        // Whoever sends from an address of its own makes work from here on.
        if self.door.would_open(self.desk.net.now(), from, datagram)
            && let Err(e) = self.desk.begin(&PeerAddress::Udp(from))
        {
            return self.desk.failed(&from, e);
        }
        let mut reply = Vec::new();
        match self.door.handle(self.desk.net.now(), from, datagram, &mut reply) {
            Reception::Reply => self.send(path, &reply),
            Reception::Knock(knock) => self.answer(path, *knock),
            Reception::Stranger => self.desk.failed(&from, HandshakeError::Stranger),
            _ => {}
        }
    }

    fn answer(&self, path: Path, knock: Knock) {
        let from = path.remote;
        let caller = (from, knock.from);
        if let Some(answer) = lock(&self.answers).get(&caller) {
            return self.send(path, answer);
        }
        let mut reply = Vec::new();
        match self.judge(&knock) {
            Ok(guest) => match self.let_in(path, knock, guest, &mut reply) {
                Ok(()) => {}
                Err(e) => return self.desk.failed(&from, HandshakeError::Io(e)),
            },
            Err(error) => {
                if let Some(refusal) = error.refusal() {
                    let answer =
                        introduce_with(&Message::Refuse(refusal), &self.config, &Counters::unframed());
                    knock.refuse(&answer, &mut reply);
                }
                self.desk.failed(&from, error);
            }
        }
        self.send(path, &reply);
    }

    /// Whether the caller may come in.
    fn judge(&self, knock: &Knock) -> Result<Guest, HandshakeError> {
        let counters = Counters::unframed();
        let (hello, reliable) = match read_introduction(&knock.hello, self.config.format, &counters) {
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
        let peer = self.desk.identify(&hello)?;
        if let (Some(key), Some(security)) = (knock.key, &self.desk.options.security) {
            security.judge(PeerKey::Udp(NoiseKey::from_bytes(key)), peer.role.as_deref())?;
        }
        // It takes the role's place only once it has shown that it is there now.
        self.desk.admits(&hello).map_err(HandshakeError::Refused)?;
        let reliable = reliable && self.config.frame_deadline.is_none();
        let batching = peer.batching.unwrap_or(self.desk.options.link.batching);
        Ok(Guest { hello, batching, reliable, counters })
    }

    /// Makes a connection of the caller, and a link once it has shown that it is there now: its first packet
    /// may be a copy of one that somebody else sent.
    fn let_in(&self, path: Path, knock: Knock, guest: Guest, reply: &mut Vec<u8>) -> io::Result<()> {
        let (desk, caller) = (&self.desk, (path.remote, knock.from));
        let here = self.free_name()?;
        let accept = Message::Accept(Accept { application: desk.application.hello().clone() });
        let answer = introduce_with(&accept, &self.config, &guest.counters);
        let Batching { size: batch, coded } = guest.batching;
        let config = Config { batch, coded, ..self.config };
        let mut connection = knock
            .take(desk.net.now(), here, &answer, config, reply)
            .ok_or_else(|| io::Error::other("the answer could not be sealed"))?;
        connection.follow(caller.0, random_bytes(&*desk.net)?);
        lock(&self.answers).insert(caller, reply.clone());
        let port = Port::new(&desk.net, &self.socket, path, connection);
        let (served, answers) = (self.board.serve(here, &port), Arc::clone(&self.answers));
        desk.net.spawn(Box::pin(async move {
            served.await;
            lock(&answers).remove(&caller);
        }));
        let slot = desk.slot(&PeerAddress::Udp(caller.0));
        desk.net.spawn(Box::pin(greet(Arc::clone(desk), port, guest, slot)));
        Ok(())
    }

    /// A name that no connection here has.
    fn free_name(&self) -> io::Result<ConnectionId> {
        loop {
            let id = ConnectionId(self.desk.net.random()? as u32);
            if !self.board.has(id) {
                return Ok(id);
            }
        }
    }

    /// What cannot be sent counts as lost: the caller asks again.
    fn send(&self, path: Path, datagram: &[u8]) {
        if !datagram.is_empty() {
            let mut outgoing = Outgoing::new(path, &*self.socket);
            outgoing.push(datagram);
            outgoing.send(&*self.socket);
        }
    }
}

/// Hands out the link with a guest once it has used its keys, or lets it go.
async fn greet(desk: Arc<Desk>, port: Arc<Port>, guest: Guest, mut slot: Slot) {
    let confirmed = poll_fn(|cx| {
        let mut state = port.lock();
        if state.connection.is_confirmed() || state.connection.closed().is_some() {
            return Poll::Ready(state.connection.is_confirmed());
        }
        state.wait(Waiter::Greeter, cx);
        Poll::Pending
    });
    let by = desk.net.now().after(desk.options.handshake);
    let confirmed = tokio::select! {
        biased;
        confirmed = until(&*desk.net, by, confirmed) => match confirmed {
            Some(true) => Ok(()),
            _ => Err(HandshakeError::TimedOut),
        },
        () = slot.revoked() => Err(HandshakeError::Refused(Refusal::Busy)),
    };
    drop(slot);
    let Guest { hello, reliable, counters, .. } = guest;
    let entered = confirmed.and_then(|()| desk.enter(&hello.application).map_err(HandshakeError::Refused));
    let (peer, place) = match entered {
        Ok((peer, place)) => (peer, Some(Arc::new(place) as _)),
        Err(error) => {
            port.lock().connection.close();
            port.settle(desk.net.now());
            return desk.failed(&port.remote(), error);
        }
    };
    let format = desk.application.format();
    let link = (hello.session, reliable);
    desk.hand_out(super::parts(&port, &desk.options.udp, format, peer, link, counters, place)).await;
}
