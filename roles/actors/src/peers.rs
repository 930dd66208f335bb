//! The peers of a role, as they come and reconnect: a display's cullers, a culler's displays.
//!
//! Each peer has a slot. The configuration decides who connects: a role connects to the peers whose endpoints
//! it is given, and accepts others at its listener. The slot of a lost peer is filled again.

use std::{
    collections::{BTreeMap, VecDeque},
    future::pending,
    sync::Arc,
    time::Duration,
};

use parking_lot::Mutex;
use tokio::sync::{mpsc, oneshot};
use trimaran_proto::{Identity, Role, SessionKey, Walkthrough};
use trimaran_transport::{AcceptError, ConnectError, Endpoint, Net, causes, connect};

use crate::{
    join::{JoinError, PeerEndpoint, expect_role},
    links::{Link, Listener},
    meeting::Expected,
};

/// How long a role tries to reach a peer before it logs the reason. It keeps trying. The first try is
/// shorter, so that the reason is known soon, and is not logged: the peer may be starting.
const FIRST_ATTEMPT: Duration = Duration::from_secs(3);
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
    obstacles: Obstacles,
}

/// Why peers cannot be reached, by the number of their slot.
type Obstacles = Arc<Mutex<BTreeMap<usize, String>>>;

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
        Self {
            arrivals: mpsc::channel(1).1,
            early: VecDeque::new(),
            expected: 0,
            obstacles: Obstacles::default(),
        }
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
        let (expected, obstacles) = (endpoints.len(), Obstacles::default());
        for (place, peer) in endpoints.into_iter().enumerate() {
            let (arrived, obstacles) = (arrived.clone(), Arc::clone(&obstacles));
            let connector = Connector { net: Arc::clone(net), place, peer, identity, role, obstacles };
            net.spawn(Box::pin(connector.run(arrived)));
        }
        if let Some(listener) = listener {
            let slots = Slots { first: expected, most: most.saturating_sub(expected), all: Vec::new() };
            net.spawn(Box::pin(acceptor(Arc::clone(net), slots, listener, role, arrived, met)));
        }
        Self { arrivals, early: VecDeque::new(), expected, obstacles }
    }

    /// How many peers the role connects to.
    #[must_use]
    pub const fn expected(&self) -> usize {
        self.expected
    }

    /// Why the peer of this slot was not reached by the last attempt, if one has failed.
    #[must_use]
    pub fn obstacle(&self, place: usize) -> Option<String> {
        self.obstacles.lock().get(&place).cloned()
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
struct Connector {
    net: Arc<dyn Net>,
    place: usize,
    peer: PeerEndpoint,
    identity: Identity,
    role: Role,
    obstacles: Obstacles,
}

impl Connector {
    async fn run(self, arrived: Arrived) {
        let Self { net, place, peer: PeerEndpoint { endpoint, options }, identity, role, obstacles } = self;
        let (mut logged, mut time) = (String::new(), FIRST_ATTEMPT);
        loop {
            let attempt = connect::<Walkthrough>(&net, &endpoint, identity, &options, net.now().after(time));
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
                    obstacles.lock().remove(&place);
                    let (slot, free) = SlotGuard::new();
                    let arrival = Arrival { place, link, at: Some(endpoint.clone()), slot };
                    if arrived.send(Ok(arrival)).await.is_err() {
                        return;
                    }
                    let _dropped = free.await;
                }
                Err(error) if error.may_pass() => {
                    let why = obstacle(&error);
                    if time == ATTEMPT && why != logged {
                        tracing::warn!(%endpoint, "cannot reach the {role}, and goes on trying: {why}");
                        logged.clone_from(&why);
                    }
                    obstacles.lock().insert(place, why);
                    time = ATTEMPT;
                }
                Err(error) => {
                    let _nobody = arrived.send(Err(error)).await;
                    return;
                }
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

/// The slots for peers that connect, made as they come.
struct Slots {
    /// The number of the first.
    first: usize,
    most: usize,
    all: Vec<Slot>,
}

impl Slots {
    /// A slot for a peer of this session: its own, if it reconnects, or a free one, and its number.
    fn take(&mut self, session: Option<SessionKey>) -> Option<(usize, SlotGuard)> {
        let own = self.all.iter().position(|slot| session.is_some() && slot.session == session);
        let vacant = own.or_else(|| self.all.iter_mut().position(Slot::is_free));
        let (guard, free) = SlotGuard::new();
        let slot = Slot { session, taken: Some(free) };
        let place = match vacant {
            Some(place) => {
                *self.all.get_mut(place)? = slot;
                place
            }
            None if self.all.len() < self.most => {
                self.all.push(slot);
                self.all.len() - 1
            }
            None => return None,
        };
        Some((self.first + place, guard))
    }
}

/// A slot for a peer that connects.
struct Slot {
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
    mut slots: Slots,
    mut listener: Listener,
    role: Role,
    arrived: Arrived,
    met: Expected,
) {
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
        let Some((place, slot)) = slots.take(session) else {
            tracing::warn!(from = %link.peer.address, "turned a {role} away: all places are taken");
            continue;
        };
        let arrival = Arrival { place, link, at: None, slot };
        if arrived.send(Ok(arrival)).await.is_err() {
            return;
        }
    }
}
