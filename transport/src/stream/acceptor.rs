//! Accepting connections over byte streams, and joining those of a link.

use parking_lot::Mutex;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::task::{Context, Waker};
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::oneshot;
use trimaran_wire::{Hello, IdleTimeout, Lane, Message, Refusal, SessionId, WireVersions};

use super::handshake::{Connection, Lanes};
use crate::acceptor::{Acceptor, Place};
use crate::handshake::{Handshake, HandshakeError};
use crate::peer::{Peer, PeerAddress};
use crate::pending::Slot;
use crate::stats::Counters;
use crate::transport::Transport;
use trimaran_net::{Instant, Listen, Stream, StreamPeer, sleep_until, until};

/// The pause after a failed accept, for instance for lack of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// The lanes beside the channels.
const LANES: usize = 4;

/// Accepts until nobody takes the links any more.
pub(crate) async fn serve(acceptor: Arc<Acceptor>, socket: Box<dyn Listen>, transport: Arc<dyn Transport>) {
    Arc::new(Reception { acceptor, transport, waiting: Mutex::default() }).serve(socket).await;
}

/// Receives connections, checks their peers, and joins those of a link.
#[derive(Debug)]
struct Reception {
    acceptor: Arc<Acceptor>,
    transport: Arc<dyn Transport>,
    /// The sessions that lack a lane.
    waiting: Mutex<HashMap<SessionId, Waiting>>,
}

/// A session with some of its lanes.
#[derive(Debug)]
struct Waiting {
    /// The application's hello on each of them.
    application: Bytes,
    /// The versions that each of them offers.
    versions: WireVersions,
    arrived: BTreeMap<Lane, Arrived>,
}

/// A connection whose session lacks another lane.
#[derive(Debug)]
struct Arrived {
    connection: Connection,
    /// Dropped when the others have come: stops the task that watches the time.
    _joined: oneshot::Sender<()>,
}

/// The outcome of a hello.
#[expect(clippy::large_enum_variant, reason = "none is kept")]
enum Entry {
    /// All lanes are there, and there is a place.
    Complete(Lanes, Peer, Place),
    /// Another lane has to come.
    Wait(oneshot::Receiver<()>),
    /// Refused.
    Refused(Connection, Refusal),
}

impl Reception {
    async fn serve(self: Arc<Self>, mut socket: Box<dyn Listen>) {
        loop {
            let accepted = tokio::select! {
                biased;
                () = self.acceptor.closed() => return,
                accepted = socket.accept() => accepted,
            };
            match accepted {
                Ok(stream) => match self.admit(stream.peer) {
                    Ok(slot) => {
                        let reception = Arc::clone(&self);
                        self.acceptor.net.spawn(Box::pin(reception.receive(stream, slot)));
                    }
                    Err(e) => {
                        self.acceptor.failed(&self.address(stream.peer), e);
                        // Before an upgrade nothing can be sent.
                        if self.transport.upgrade().is_none() {
                            turn_away(&mut self.connection(stream));
                        }
                    }
                },
                Err(e) => {
                    tracing::warn!(error = &e as &dyn std::error::Error, "could not accept a connection");
                    sleep_until(&*self.acceptor.net, self.acceptor.net.now().after(ACCEPT_PAUSE)).await;
                }
            }
        }
    }

    fn connection(&self, stream: Stream) -> Connection {
        let format = self.acceptor.application.format();
        Connection::new(stream, &*self.transport, format, &Counters::framed())
    }

    fn address(&self, peer: StreamPeer) -> PeerAddress {
        PeerAddress::over(self.transport.scheme(), peer)
    }

    /// Whether a connection may shake hands. Peers that the transport does not admit get no slot.
    fn admit(&self, peer: StreamPeer) -> Result<Slot, HandshakeError> {
        self.transport.admit(peer).map_err(HandshakeError::NotLetIn)?;
        let address = self.address(peer);
        self.acceptor.begin(&address)?;
        Ok(self.acceptor.slot(&address))
    }

    /// One connection, from its first byte to a link or a failure.
    async fn receive(self: Arc<Self>, stream: Stream, mut slot: Slot) {
        let address = self.address(stream.peer);
        let deadline = self.acceptor.net.now().after(self.acceptor.link.handshake_timeout);
        // A lane that waits for another one watches the deadline itself, in order to refuse politely. The
        // limit is for a peer that does not even read the refusal.
        let limit = deadline.after(self.acceptor.link.handshake_timeout);
        let handshake = self.shake_hands(stream, deadline, &mut slot);
        let outcome =
            until(&*self.acceptor.net, limit, handshake).await.unwrap_or(Err(HandshakeError::TimedOut));
        if let Err(e) = outcome {
            self.acceptor.failed(&address, e);
        }
    }

    async fn shake_hands(
        &self,
        stream: Stream,
        deadline: Instant,
        slot: &mut Slot,
    ) -> Result<(), HandshakeError> {
        let net = &*self.acceptor.net;
        let stream = match self.transport.upgrade() {
            None => stream,
            Some(upgrade) => tokio::select! {
                biased;
                upgraded = until(net, deadline, upgrade.upgrade(stream)) => {
                    upgraded.ok_or(HandshakeError::TimedOut)?.map_err(HandshakeError::Io)?
                }
                () = slot.revoked() => return Err(HandshakeError::Refused(Refusal::Busy)),
            },
        };
        let mut connection = self.connection(stream);
        let hello = tokio::select! {
            biased;
            hello = until(net, deadline, connection.recv_hello()) => hello.ok_or(HandshakeError::TimedOut)??,
            () = slot.revoked() => return Err(turn_away(&mut connection)),
        };
        let Hello { session, lane, idle_timeout, .. } = hello;
        match self.enter(hello, connection) {
            Entry::Complete(lanes, peer, place) => {
                self.welcome(session, idle_timeout, lanes, (peer, place)).await
            }
            Entry::Wait(joined) => {
                let revoked = tokio::select! {
                    biased;
                    joined = until(net, deadline, joined) => match joined {
                        Some(_) => return Ok(()),
                        None => false,
                    },
                    () = slot.revoked() => true,
                };
                let Some(mut connection) = self.withdraw(session, lane) else {
                    return Ok(());
                };
                if revoked {
                    return Err(turn_away(&mut connection));
                }
                let refusal = Refusal::Unpaired { session };
                Err(connection.refuse(refusal).await)
            }
            Entry::Refused(mut connection, refusal) => Err(connection.refuse(refusal).await),
        }
    }

    /// Takes back the connection of a lane whose wait has ended, unless it has been joined.
    fn withdraw(&self, session: SessionId, lane: Lane) -> Option<Connection> {
        let mut sessions = self.waiting.lock();
        let waiting = sessions.get_mut(&session)?;
        let arrived = waiting.arrived.remove(&lane);
        if waiting.arrived.is_empty() {
            sessions.remove(&session);
        }
        arrived.map(|arrived| arrived.connection)
    }

    /// Joins a connection with those of the other lanes, if they are there.
    fn enter(&self, hello: Hello, connection: Connection) -> Entry {
        let Hello { session, lane, .. } = hello;
        if let Err(refusal) = self.acceptor.admits(&hello) {
            return Entry::Refused(connection, refusal);
        }
        let channels = self.acceptor.format().channels;
        let unknown = matches!(lane, Lane::Channel(number) if number.index() >= channels.len());
        let mut sessions = self.waiting.lock();
        let (application, versions) = (&hello.application, hello.versions);
        let new = || Waiting { application: application.clone(), versions, arrived: BTreeMap::new() };
        let waiting = sessions.entry(session).or_insert_with(new);
        let differs = waiting.application != *application || waiting.versions != versions;
        if unknown || differs || waiting.arrived.contains_key(&lane) {
            return Entry::Refused(connection, Refusal::Session { session, lane });
        }
        let is_last = waiting.arrived.len() + 1 == LANES + channels.len();
        let place = match is_last.then(|| self.acceptor.enter(&hello)).transpose() {
            Ok(place) => place,
            Err(refusal) => return Entry::Refused(connection, refusal),
        };
        let (_joined, watch) = oneshot::channel();
        waiting.arrived.insert(lane, Arrived { connection, _joined });
        let Some((peer, place)) = place else { return Entry::Wait(watch) };
        let all = sessions.remove(&session).map(|waiting| waiting.arrived).unwrap_or_default();
        let all = all.into_iter().map(|(lane, arrived)| (lane, arrived.connection)).collect();
        match Lanes::of(all, channels, &*self.transport) {
            Some(lanes) => Entry::Complete(lanes, peer, place),
            None => Entry::Wait(watch),
        }
    }

    /// Answers on each lane, and hands out the link.
    async fn welcome(
        &self,
        session: SessionId,
        idle_timeout: IdleTimeout,
        mut lanes: Lanes,
        (peer, place): (Peer, Place),
    ) -> Result<(), HandshakeError> {
        let Acceptor { net, link, .. } = &*self.acceptor;
        let accept = Message::Accept(self.acceptor.answer(&peer));
        lanes.accept(&accept).await?;
        let parts = lanes.into_parts(net, link.agreed(idle_timeout), peer, session).holding(place);
        self.acceptor.hand_out(parts).await;
        Ok(())
    }
}

/// Refuses for lack of room, if that needs no waiting, and returns the error of the handshake.
fn turn_away(connection: &mut Connection) -> HandshakeError {
    let refusal = std::pin::pin!(connection.dismiss(Refusal::Busy));
    let _ignored = refusal.poll(&mut Context::from_waker(Waker::noop()));
    HandshakeError::Refused(Refusal::Busy)
}
