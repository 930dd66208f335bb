//! Who is let in at a listener, whatever its transport.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::mpsc;
use trimaran_proto::{Identity, Refusal, Role};

use crate::handshake::HandshakeError;
use crate::keys::WrongRole;
use crate::pending::{Pending, Slot};
use crate::rates::{Door, Handshakes, Origin, Sparse, TurnedAway};
use crate::{Link, Options, PeerAddress};
use trimaran_net::Net;

/// Admits peers and hands their links to whoever accepts. A transport's listening task holds it, asks
/// [`Desk::enter`] once a peer has introduced itself, and ends when [`Desk::closed`] does.
#[derive(Debug)]
pub(crate) struct Desk {
    pub(crate) net: Arc<dyn Net>,
    pub(crate) identity: Identity,
    pub(crate) options: Options,
    taken: Arc<Mutex<Vec<Role>>>,
    pending: Pending,
    handshakes: Arc<Handshakes>,
    done: mpsc::Sender<Link>,
    last_failure: Mutex<Option<HandshakeError>>,
    warnings: Sparse,
    /// What known keys have claimed without right: each is worth a line, once.
    wrong_roles: Mutex<Vec<WrongRole>>,
}

/// A role's place at the listener: freed when the last half of its link is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    role: Role,
    taken: Arc<Mutex<Vec<Role>>>,
}

impl Drop for Place {
    fn drop(&mut self) {
        lock(&self.taken).retain(|role| *role != self.role);
    }
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Everything under these locks is changed in single steps, so that a panic elsewhere leaves it sound.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Desk {
    /// A desk that receives peers of `identity` and hands their links to `done`.
    pub(crate) fn new(
        net: &Arc<dyn Net>,
        identity: Identity,
        options: &Options,
        done: mpsc::Sender<Link>,
    ) -> Self {
        Self {
            net: Arc::clone(net),
            identity,
            options: options.clone(),
            taken: Arc::default(),
            pending: Pending::new(options.limits.handshakes),
            handshakes: Arc::new(Handshakes::new(&options.limits)),
            done,
            last_failure: Mutex::default(),
            warnings: Sparse::default(),
            wrong_roles: Mutex::default(),
        }
    }

    /// Counts a handshake that begins.
    pub(crate) fn begin(&self, from: &PeerAddress) -> Result<(), HandshakeError> {
        self.handshakes.begin(self.net.now(), from).map_err(HandshakeError::TooMany)
    }

    /// A slot for one more handshake; one that is under way loses its own where all are taken.
    pub(crate) fn slot(&self, from: &PeerAddress) -> Slot {
        let (slot, evicted) = self.pending.take(Origin::of(from));
        if evicted {
            self.handshakes.no_room();
        }
        slot
    }

    /// What was turned away.
    pub(crate) fn turned_away(&self) -> TurnedAway {
        self.handshakes.turned_away()
    }

    /// Whether `theirs` may come in, without taking the place.
    pub(crate) fn admits(&self, theirs: &Identity) -> Result<(), Refusal> {
        self.vacant(theirs, &lock(&self.taken))
    }

    /// Takes the place of `theirs`.
    pub(crate) fn enter(&self, theirs: &Identity) -> Result<Place, Refusal> {
        let mut taken = lock(&self.taken);
        self.vacant(theirs, &taken)?;
        taken.push(theirs.role);
        Ok(Place { role: theirs.role, taken: Arc::clone(&self.taken) })
    }

    fn vacant(&self, theirs: &Identity, taken: &[Role]) -> Result<(), Refusal> {
        self.identity.admits(theirs)?;
        if taken.contains(&theirs.role) {
            return Err(Refusal::RoleTaken { role: theirs.role });
        }
        if taken.len() >= self.options.limits.peers {
            self.handshakes.no_place();
            return Err(Refusal::Busy);
        }
        Ok(())
    }

    /// Hands out a link. Where nobody takes it, dropping it tells the peer.
    pub(crate) async fn hand_out(&self, link: Link) {
        link.stats.came_through(Door(Arc::clone(&self.handshakes)));
        let _unwanted = self.done.send(link).await;
    }

    /// Ends when nobody accepts any more.
    pub(crate) async fn closed(&self) {
        self.done.closed().await;
    }

    /// Notes what became of a connection that did not make it to a link. Who does not go together with this
    /// side is worth a line in the log, though strangers must not fill it. What a known key claims they
    /// can neither fill nor hide.
    pub(crate) fn failed(&self, address: &dyn fmt::Display, error: HandshakeError) {
        let cause = &error as &dyn std::error::Error;
        let told = match &error {
            HandshakeError::WrongRole(claim) => self.is_news(claim).then_some(0),
            _ => error.is_mismatch().then(|| self.warnings.take(self.net.now())).flatten(),
        };
        match told {
            Some(untold) => {
                tracing::warn!(%address, error = cause, untold, "turned away; others are waited for");
            }
            None => tracing::debug!(%address, error = cause, "a handshake failed"),
        }
        *lock(&self.last_failure) = Some(error);
    }

    fn is_news(&self, claim: &WrongRole) -> bool {
        let mut known = lock(&self.wrong_roles);
        let news = !known.contains(claim);
        if news {
            known.push(claim.clone());
        }
        news
    }

    /// Takes what became of the last connection that did not make it to a link.
    pub(crate) fn last_failure(&self) -> Option<HandshakeError> {
        lock(&self.last_failure).take()
    }
}
