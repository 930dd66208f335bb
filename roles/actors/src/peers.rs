//! The peers of a role, as they come and reconnect: a display's cullers, a culler's displays.
//!
//! Each peer has a slot. The configuration decides who connects: a role connects to the peers whose endpoints
//! it is given, and accepts others at its listener. The slot of a lost peer is filled again.

use std::{collections::VecDeque, future::pending, sync::Arc, time::Duration};

use tokio::sync::{mpsc, oneshot};
use trimaran_proto::{Identity, Role, SessionKey, Walkthrough};
use trimaran_transport::{AcceptError, ConnectError, Endpoint, Net, causes, connect};

use crate::{
    join::{JoinError, PeerEndpoint, expect_role},
    links::{Link, Listener},
    meeting::Expected,
};

/// How long a role tries to reach a peer before it logs the reason. It keeps trying.
const ATTEMPT: Duration = Duration::from_secs(15);
/// How long a listener waits before it waits again.
const WAIT: Duration = Duration::from_secs(3600);

/// A peer that has come.
#[derive(Debug)]
pub struct Arrival {
    /// The number of its slot, from 0: first those that are connected to, in the order given.
    pub place: usize,
    /// The link to it.
    pub link: Link,
    /// Its endpoint, if this role connects to it.
    pub at: Option<Endpoint>,
    /// Its slot.
    pub slot: SlotGuard,
}

/// A peer's slot: dropping it frees the slot, and another link is made.
#[derive(Debug)]
pub struct SlotGuard {
    _held: oneshot::Sender<()>,
}

impl SlotGuard {
    /// The slot of a peer that is not replaced.
    #[must_use]
    pub fn once() -> Self {
        Self::new().0
    }

    /// A guard, and a receiver that its drop closes.
    fn new() -> (Self, oneshot::Receiver<()>) {
        let (held, free) = oneshot::channel();
        (Self { _held: held }, free)
    }
}

/// Peers as they come.
#[derive(Debug)]
pub struct Peers {
    arrivals: mpsc::Receiver<Result<Arrival, JoinError>>,
    /// Peers put back, which come first.
    early: VecDeque<Arrival>,
    expected: usize,
}

/// The peers of a role.
#[derive(Debug)]
pub struct PeersConfig {
    /// The role's introduction.
    pub identity: Identity,
    /// The expected role of its peers.
    pub role: Role,
    /// The endpoints that it connects to.
    pub endpoints: Vec<PeerEndpoint>,
    /// Where others connect to it.
    pub listener: Option<Listener>,
    /// The most peers at once.
    pub most: usize,
}

impl Peers {
    /// No peers.
    #[must_use]
    pub fn none() -> Self {
        Self { arrivals: mpsc::channel(1).1, early: VecDeque::new(), expected: 0 }
    }

    /// Connects to and accepts peers until this is dropped.
    #[must_use]
    pub fn seek(net: &Arc<dyn Net>, sought: PeersConfig) -> Self {
        Self::seek_and_expect(net, sought, Expected::default())
    }

    /// The same for a culler, which also accepts other cullers with an expected key.
    pub(crate) fn seek_and_expect(net: &Arc<dyn Net>, sought: PeersConfig, met: Expected) -> Self {
        let PeersConfig { identity, role, endpoints, listener, most } = sought;
        let (arrived, arrivals) = mpsc::channel(1);
        let expected = endpoints.len();
        for (place, peer) in endpoints.into_iter().enumerate() {
            let arrived = arrived.clone();
            net.spawn(Box::pin(connector(Arc::clone(net), place, peer, identity, role, arrived)));
        }
        if let Some(listener) = listener {
            let places = (expected..most).collect();
            net.spawn(Box::pin(acceptor(Arc::clone(net), places, listener, role, arrived, met)));
        }
        Self { arrivals, early: VecDeque::new(), expected }
    }

    /// How many peers the role connects to.
    #[must_use]
    pub const fn expected(&self) -> usize {
        self.expected
    }

    /// Returns this one first from the next call.
    pub fn put_back(&mut self, arrival: Arrival) {
        self.early.push_back(arrival);
    }

    /// The next peer. Pending for ever if no more can come. Dropping the future loses none.
    ///
    /// # Errors
    /// When this role's settings rule out a link to one of them. That one is not tried again.
    pub async fn next(&mut self) -> Result<Arrival, JoinError> {
        if let Some(early) = self.early.pop_front() {
            return Ok(early);
        }
        match self.arrivals.recv().await {
            Some(arrival) => arrival,
            None => pending().await,
        }
    }
}

type Arrived = mpsc::Sender<Result<Arrival, JoinError>>;

/// Keeps a link to one peer.
async fn connector(
    net: Arc<dyn Net>,
    place: usize,
    PeerEndpoint { endpoint, options }: PeerEndpoint,
    identity: Identity,
    role: Role,
    arrived: Arrived,
) {
    let mut logged = String::new();
    loop {
        let attempt = connect::<Walkthrough>(&net, &endpoint, identity, &options, net.now().after(ATTEMPT));
        let link = tokio::select! {
            biased;
            () = arrived.closed() => return,
            link = attempt => link,
        };
        let link = link
            .map_err(|cause| JoinError::Connect { peer: role, cause: Box::new(cause) })
            .and_then(|link| expect_role(&link, role).map(|()| link));
        match link {
            Ok(link) => {
                logged.clear();
                let (slot, free) = SlotGuard::new();
                let arrival = Arrival { place, link, at: Some(endpoint.clone()), slot };
                if arrived.send(Ok(arrival)).await.is_err() {
                    return;
                }
                let _dropped = free.await;
            }
            Err(error) if error.may_pass() => {
                let why = obstacle(&error);
                if why != logged {
                    tracing::warn!(%endpoint, "cannot reach the {role}, and goes on trying: {why}");
                    logged = why;
                }
            }
            Err(error) => {
                let _nobody = arrived.send(Err(error)).await;
                return;
            }
        }
    }
}

/// The obstacle of the last attempt.
fn obstacle(error: &JoinError) -> String {
    match error {
        JoinError::Connect { cause, .. } => match &**cause {
            ConnectError::Deadline { last, .. } => causes(last),
            other => causes(other),
        },
        other => causes(other),
    }
}

/// A slot for a peer that connects.
struct Slot {
    number: usize,
    /// Its present or past session.
    session: Option<SessionKey>,
    taken: Option<oneshot::Receiver<()>>,
}

impl Slot {
    fn is_free(&mut self) -> bool {
        let free = Err(oneshot::error::TryRecvError::Closed);
        self.taken.as_mut().is_none_or(|taken| taken.try_recv() == free)
    }
}

/// Accepts as many peers as there are slots. A peer that reconnects for its session gets its old slot.
async fn acceptor(
    net: Arc<dyn Net>,
    places: Vec<usize>,
    mut listener: Listener,
    role: Role,
    arrived: Arrived,
    met: Expected,
) {
    let mut slots: Vec<_> =
        places.into_iter().map(|number| Slot { number, session: None, taken: None }).collect();
    loop {
        let came = tokio::select! {
            biased;
            () = arrived.closed() => return,
            came = listener.accept(net.now().after(WAIT)) => came,
        };
        let link = match came {
            Ok(link) => link,
            Err(AcceptError::Deadline { .. }) => continue,
            Err(_) => return,
        };
        let hello = link.peer.hello;
        let session = hello.session.map(|(key, _)| key);
        if hello.role != role {
            if let Some(key) = session {
                met.came(key, link);
            }
            continue;
        }
        let own = slots.iter().position(|slot| session.is_some() && slot.session == session);
        let vacant = own.or_else(|| slots.iter_mut().position(Slot::is_free));
        let Some(slot) = vacant.and_then(|slot| slots.get_mut(slot)) else {
            tracing::warn!(from = %link.peer.address, "turned a {role} away: all places are taken");
            continue;
        };
        let (guard, free) = SlotGuard::new();
        (slot.session, slot.taken) = (session, Some(free));
        let arrival = Arrival { place: slot.number, link, at: None, slot: guard };
        if arrived.send(Ok(arrival)).await.is_err() {
            return;
        }
    }
}
