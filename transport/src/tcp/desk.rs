//! Where connections are received until they are links.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Waker};
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc, oneshot};
use trimaran_proto::{Accept, Hello, Identity, Lane, Message, Refusal, Role, SessionId};

use super::handshake::{Connection, HandshakeError, Lanes};
use super::options::Options;
use crate::Link;
use crate::net::{Instant, Listen, Net, Stream, sleep_until, until};
use crate::stats::Counters;

/// The pause after the system could not accept, for instance for want of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Receives connections, checks who they are, and pairs them.
#[derive(Debug)]
pub(super) struct Desk {
    net: Arc<dyn Net>,
    identity: Identity,
    options: Options,
    book: Arc<Mutex<Book>>,
    done: mpsc::Sender<Link>,
    last_failure: Mutex<Option<HandshakeError>>,
}

/// Which sessions have one connection, and which roles have a link.
#[derive(Debug, Default)]
struct Book {
    waiting: HashMap<SessionId, Waiting>,
    taken: Vec<Role>,
}

/// A connection whose session lacks the other lane.
#[derive(Debug)]
struct Waiting {
    hello: Hello,
    connection: Connection,
    /// Dropped when the other lane comes: tells the task that watches the time to stop.
    _paired: oneshot::Sender<()>,
}

/// A role's place at the listener: freed when the last half of its link is dropped.
#[derive(Debug)]
struct Place {
    role: Role,
    book: Arc<Mutex<Book>>,
}

impl Drop for Place {
    fn drop(&mut self) {
        lock(&self.book).taken.retain(|role| *role != self.role);
    }
}

/// What the book says to a hello.
enum Entry {
    /// Both lanes are there, and the role is this link's.
    Complete(Lanes, Place),
    /// The other lane has to come.
    Wait(oneshot::Receiver<()>),
    /// No.
    Refused(Connection, Refusal),
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Everything under these locks is changed in single steps, so that a panic elsewhere leaves it sound.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Desk {
    /// A desk that receives peers of `identity` and hands their links to `done`.
    pub(super) fn new(
        net: &Arc<dyn Net>,
        identity: Identity,
        options: Options,
        done: mpsc::Sender<Link>,
    ) -> Self {
        Self {
            net: Arc::clone(net),
            identity,
            options,
            book: Arc::default(),
            done,
            last_failure: Mutex::default(),
        }
    }

    /// Takes what became of the last connection that did not make it to a link.
    pub(super) fn last_failure(&self) -> Option<HandshakeError> {
        lock(&self.last_failure).take()
    }

    /// Accepts until nobody takes the links any more.
    pub(super) async fn serve(self: Arc<Self>, mut socket: Box<dyn Listen>) {
        let room = Arc::new(Semaphore::new(self.options.max_handshakes));
        loop {
            let accepted = tokio::select! {
                () = self.done.closed() => return,
                accepted = socket.accept() => accepted,
            };
            match accepted {
                Ok(stream) => {
                    let desk = Arc::clone(&self);
                    match Arc::clone(&room).try_acquire_owned() {
                        Ok(permit) => self.net.spawn(Box::pin(desk.receive(stream, permit))),
                        Err(_) => turn_away(stream),
                    }
                }
                Err(e) => {
                    tracing::warn!(error = &e as &dyn std::error::Error, "could not accept a connection");
                    sleep_until(&*self.net, self.net.now().after(ACCEPT_PAUSE)).await;
                }
            }
        }
    }

    /// One connection, from its first byte to a link or a failure.
    async fn receive(self: Arc<Self>, stream: Stream, _permit: OwnedSemaphorePermit) {
        let address = stream.peer;
        let deadline = self.net.now().after(self.options.handshake);
        // A lane that waits for the other one watches the deadline itself, in order to refuse politely; the limit is for a peer
        // that does not even read the refusal.
        let limit = deadline.after(self.options.handshake);
        let handshake = self.shake_hands(stream, deadline);
        let outcome = until(&*self.net, limit, handshake).await.unwrap_or(Err(HandshakeError::TimedOut));
        if let Err(e) = outcome {
            tracing::debug!(%address, error = &e as &dyn std::error::Error, "a handshake failed");
            *lock(&self.last_failure) = Some(e);
        }
    }

    async fn shake_hands(&self, stream: Stream, deadline: Instant) -> Result<(), HandshakeError> {
        let net = &*self.net;
        let mut connection = Connection::new(stream, &Counters::framed());
        let hello = until(net, deadline, connection.recv_hello()).await.ok_or(HandshakeError::TimedOut)??;
        match self.enter(hello, connection) {
            Entry::Complete(lanes, place) => self.welcome(hello, lanes, place).await,
            Entry::Wait(paired) => {
                if until(net, deadline, paired).await.is_some() {
                    return Ok(());
                }
                let Some(mut waiting) = lock(&self.book).waiting.remove(&hello.session) else {
                    return Ok(());
                };
                let refusal = Refusal::Unpaired { session: hello.session };
                waiting.connection.refuse(refusal).await?;
                Err(HandshakeError::Refused(refusal))
            }
            Entry::Refused(mut connection, refusal) => {
                connection.refuse(refusal).await?;
                Err(HandshakeError::Refused(refusal))
            }
        }
    }

    /// Enters a hello into the book.
    fn enter(&self, hello: Hello, connection: Connection) -> Entry {
        let Hello { identity, session, lane } = hello;
        let role = identity.role;
        if let Err(refusal) = self.identity.admits(&identity) {
            return Entry::Refused(connection, refusal);
        }
        let mut book = lock(&self.book);
        if book.taken.contains(&role) {
            return Entry::Refused(connection, Refusal::RoleTaken { role });
        }
        let Some(other) = book.waiting.remove(&session) else {
            let (_paired, watch) = oneshot::channel();
            book.waiting.insert(session, Waiting { hello, connection, _paired });
            return Entry::Wait(watch);
        };
        if other.hello.lane == lane || other.hello.identity != identity {
            book.waiting.insert(session, other);
            return Entry::Refused(connection, Refusal::Session { session, lane });
        }
        book.taken.push(role);
        let place = Place { role, book: Arc::clone(&self.book) };
        let lanes = match lane {
            Lane::Latest => Lanes { latest: connection, frames: other.connection },
            Lane::Frames => Lanes { latest: other.connection, frames: connection },
        };
        Entry::Complete(lanes, place)
    }

    /// Answers on both lanes, and hands out the link.
    async fn welcome(&self, hello: Hello, mut lanes: Lanes, place: Place) -> Result<(), HandshakeError> {
        let accept = Message::Accept(Accept { identity: self.identity });
        lanes.latest.send(&accept).await?;
        lanes.frames.send(&accept).await?;
        let Hello { identity: theirs, session, .. } = hello;
        let config = &self.options.link;
        let link = lanes.into_link(&self.net, config, &self.identity, theirs, session, Some(Arc::new(place)));
        // Nobody takes the link: dropping it tells the peer.
        let _unwanted = self.done.send(link).await;
        Ok(())
    }
}

/// Says that there is no room, if that can be said without waiting.
fn turn_away(stream: Stream) {
    let mut connection = Connection::new(stream, &Counters::framed());
    let refusal = std::pin::pin!(connection.refuse(Refusal::Busy));
    let _ignored = refusal.poll(&mut Context::from_waker(Waker::noop()));
}
