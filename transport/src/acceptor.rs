//! Admission of peers at a listener, for every transport.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fmt;
use std::sync::Arc;

use parking_lot::Mutex;
use tokio::sync::mpsc;
use trimaran_wire::{Accept, Format, Hello, Refusal, WireVersion};

use crate::PeerAddress;
use crate::application::Application;
use crate::config::limits::Limits;
use crate::config::link::LinkConfig;
use crate::handshake::HandshakeError;
use crate::parts::LinkParts;
use crate::peer::Peer;
use crate::pending::{Pending, Slot};
use crate::rates::{Handshakes, ListenerLimits, ListenerStats, Origin, Sparse};
use trimaran_net::Net;

/// Admits peers and hands their links to the accepting task. A transport's listening task holds it, asks
/// [`Acceptor::enter`] once a peer has introduced itself, and ends when [`Acceptor::closed`] does.
#[derive(Debug)]
pub struct Acceptor {
    pub(crate) net: Arc<dyn Net>,
    pub(crate) application: Arc<dyn Application>,
    pub(crate) link: LinkConfig,
    taken: Arc<Mutex<Taken>>,
    pending: Pending,
    handshakes: Arc<Handshakes>,
    done: mpsc::Sender<LinkParts>,
    serving: mpsc::WeakSender<Infallible>,
    last_failure: Mutex<Option<HandshakeError>>,
    warnings: Sparse,
    /// Wrong claims of known keys; each is logged once.
    wrong_roles: Mutex<Vec<String>>,
}

/// The places of peers.
#[derive(Debug, Default)]
struct Taken {
    /// The identity of the peer, by the number of the link.
    places: BTreeMap<u64, Option<u64>>,
    /// Old links of peers that have connected again.
    succeeded: usize,
    /// The number of links so far.
    links: u64,
}

impl Taken {
    /// The old link of a peer that connects again.
    fn old_link(&self, peer: &Peer) -> Option<u64> {
        let known = self.places.iter().find(|(_, place)| place.is_some() && **place == peer.place);
        known.map(|(link, _)| *link)
    }

    /// Whether there is room for a peer among `most`. As many again may be reconnecting.
    fn has_room(&self, peer: &Peer, most: usize) -> bool {
        self.places.len() < most || self.succeeded < most && self.old_link(peer).is_some()
    }

    fn enter(&mut self, peer: &Peer) -> u64 {
        if let Some(old) = self.old_link(peer) {
            self.places.remove(&old);
            self.succeeded += 1;
        }
        self.links += 1;
        self.places.insert(self.links, peer.place);
        self.links
    }

    fn leave(&mut self, link: u64) {
        if self.places.remove(&link).is_none() {
            self.succeeded -= 1;
        }
    }
}

/// A peer's place at the listener: freed when the last half of its link is dropped.
#[derive(Debug)]
pub struct Place {
    taken: Arc<Mutex<Taken>>,
    link: u64,
}

/// Kept by whatever holds a listener's address, and dropped after that is free:
/// [`Listener::close`](crate::Listener::close) waits for it.
#[derive(Debug)]
pub struct Serving {
    _held: Option<mpsc::Sender<Infallible>>,
}

impl Drop for Place {
    fn drop(&mut self) {
        self.taken.lock().leave(self.link);
    }
}

impl Acceptor {
    /// An acceptor that receives peers of `application` and hands their links to `done`.
    pub(crate) fn new(
        net: &Arc<dyn Net>,
        application: Arc<dyn Application>,
        link: LinkConfig,
        limits: Limits,
        done: mpsc::Sender<LinkParts>,
        serving: &mpsc::Sender<Infallible>,
    ) -> Self {
        let channels = application.format().channels.len();
        Self {
            net: Arc::clone(net),
            application,
            link,
            taken: Arc::default(),
            pending: Pending::new(4 + channels),
            handshakes: Arc::new(Handshakes::new(limits)),
            done,
            serving: serving.downgrade(),
            last_failure: Mutex::default(),
            warnings: Sparse::default(),
            wrong_roles: Mutex::default(),
        }
    }

    /// The network of the listener.
    #[must_use]
    pub fn net(&self) -> &Arc<dyn Net> {
        &self.net
    }

    /// The options of its links.
    #[must_use]
    pub const fn link(&self) -> &LinkConfig {
        &self.link
    }

    /// The sizes of the application's types.
    #[must_use]
    pub fn format(&self) -> Format {
        self.application.format()
    }

    /// This side's answer to the hello of a peer that has [entered](Acceptor::enter).
    #[must_use]
    pub fn answer(&self, peer: &Peer) -> Accept {
        let (idle_timeout, application) = (self.link.idle_timeout.into(), self.application.hello().clone());
        Accept { version: peer.version, idle_timeout, application }
    }

    /// Counts a new handshake.
    ///
    /// # Errors
    /// If too many begin: the transport drops it.
    pub fn begin(&self, from: &PeerAddress) -> Result<(), HandshakeError> {
        self.handshakes.begin(self.net.now(), from).map_err(HandshakeError::TooMany)
    }

    /// A slot for one more handshake. If all are taken, another handshake loses its own.
    #[must_use]
    pub fn slot(&self, from: &PeerAddress) -> Slot {
        let (slot, evicted) = self.pending.take(Origin::of(from), self.limits().handshakes);
        if evicted {
            self.handshakes.no_room();
        }
        slot
    }

    /// The limits of this moment.
    pub(crate) fn limits(&self) -> Limits {
        self.handshakes.limits()
    }

    /// A handle on the limits.
    pub(crate) fn changeable_limits(&self) -> ListenerLimits {
        ListenerLimits(Arc::clone(&self.handshakes))
    }

    /// The counts of refused handshakes.
    pub(crate) fn stats(&self) -> ListenerStats {
        ListenerStats(Arc::clone(&self.handshakes))
    }

    /// The peer that sent `hello`, whether admitted or not.
    ///
    /// # Errors
    /// If it has another protocol or other versions of the wire, or its hello cannot be read.
    pub fn identify(&self, hello: &Hello) -> Result<Peer, HandshakeError> {
        let version = self.common_version(hello).map_err(HandshakeError::Refused)?;
        Ok(Peer { version, ..self.application.recognize(&hello.application)? })
    }

    /// Whether the sender of `hello` may come in; it takes no place yet.
    ///
    /// # Errors
    /// As [`enter`](Acceptor::enter).
    pub fn admits(&self, hello: &Hello) -> Result<(), Refusal> {
        self.vacant(hello, &self.taken.lock()).map(|_| ())
    }

    /// The highest version that both speak, if the peer has this side's protocol.
    fn common_version(&self, hello: &Hello) -> Result<WireVersion, Refusal> {
        let (listener, connector) = (self.link.versions, hello.versions);
        let version = listener.accepts(connector).ok_or(Refusal::Version { listener, connector })?;
        let (listener, connector) = (self.application.protocol(), hello.protocol.clone());
        if listener != connector {
            return Err(Refusal::Protocol { listener, connector });
        }
        self.application.compare(&hello.channels)?;
        Ok(version)
    }

    /// Takes the place of the peer that sent `hello`.
    ///
    /// # Errors
    /// If it has another protocol or other versions of the wire, is rejected, or there is no place.
    pub fn enter(&self, hello: &Hello) -> Result<(Peer, Place), Refusal> {
        let mut taken = self.taken.lock();
        let peer = self.vacant(hello, &taken)?;
        let link = taken.enter(&peer);
        Ok((peer, Place { taken: Arc::clone(&self.taken), link }))
    }

    fn vacant(&self, hello: &Hello, taken: &Taken) -> Result<Peer, Refusal> {
        let version = self.common_version(hello)?;
        let peer = Peer { version, ..self.application.admit(&hello.application)? };
        if !taken.has_room(&peer, self.limits().peers) {
            self.handshakes.no_place();
            return Err(Refusal::Busy);
        }
        Ok(peer)
    }

    /// Hands out a link. If nobody accepts it, dropping it tells the peer.
    pub async fn hand_out(&self, parts: LinkParts) {
        parts.counters.handle().came_from(self.stats());
        let _unwanted = self.done.send(parts).await;
    }

    /// For the task that listens: [`Serving`].
    #[must_use]
    pub fn serving(&self) -> Serving {
        Serving { _held: self.serving.upgrade() }
    }

    /// Ends when nobody accepts any more.
    pub async fn closed(&self) {
        self.done.closed().await;
    }

    /// Notes how a connection failed before it became a link. Mismatches are logged, but strangers must not
    /// flood the log. They can neither flood nor hide the claims of known keys.
    pub fn failed(&self, address: &dyn fmt::Display, error: HandshakeError) {
        let cause = &error as &dyn std::error::Error;
        let told = match error.wrong_role() {
            Some(_) => self.is_news(error.to_string()).then_some(0),
            None => error.is_mismatch().then(|| self.warnings.take(self.net.now())).flatten(),
        };
        match told {
            Some(untold) => {
                tracing::warn!(%address, error = cause, untold, "turned away; others are waited for");
            }
            None => tracing::debug!(%address, error = cause, "a handshake failed"),
        }
        *self.last_failure.lock() = Some(error);
    }

    fn is_news(&self, claim: String) -> bool {
        let mut known = self.wrong_roles.lock();
        let news = !known.contains(&claim);
        if news {
            known.push(claim);
        }
        news
    }

    /// Takes the last failure of a connection before it became a link.
    pub(crate) fn last_failure(&self) -> Option<HandshakeError> {
        self.last_failure.lock().take()
    }
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;

    use super::*;
    use crate::peer::PeerName;

    fn peer(place: Option<u64>) -> Peer {
        let (hello, name, version) = (Bytes::new(), PeerName::new("a display"), WireVersion::CURRENT);
        Peer { hello, name, version, role: None, place, batching: None }
    }

    #[test]
    fn who_comes_again_takes_its_own_place() {
        let mut taken = Taken::default();
        let (known, other) = (peer(Some(7)), peer(Some(8)));
        let first = taken.enter(&known);
        assert!(!taken.has_room(&other, 1) && !taken.has_room(&peer(None), 1));
        assert!(taken.has_room(&known, 1));
        let second = taken.enter(&known);
        assert!(!taken.has_room(&other, 1), "it has one place");
        assert!(!taken.has_room(&known, 1), "the old link is there still");
        taken.leave(first);
        assert!(!taken.has_room(&other, 1) && taken.has_room(&known, 1));
        taken.leave(second);
        assert!(taken.has_room(&other, 1));
    }

    #[test]
    fn who_is_not_known_has_a_place_for_each_link() {
        let mut taken = Taken::default();
        let links = [(); 2].map(|()| taken.enter(&peer(None)));
        assert!(!taken.has_room(&peer(None), 2));
        links.into_iter().for_each(|link| taken.leave(link));
        assert!(taken.places.is_empty() && taken.succeeded == 0);
    }
}
