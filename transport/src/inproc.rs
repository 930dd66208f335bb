//! Links within one process: nothing is encoded, ids are shared.

mod queue;

use std::collections::{HashMap, VecDeque};
use std::io;
use std::sync::{Arc, LazyLock, Mutex, Weak};

use tokio::sync::watch;
use trimaran_proto::{Camera, Goodbye, Identity, Kind, Message, Refusal, SessionId};

use crate::Name;
use crate::connect::{AttemptError, Introduction};
use crate::desk::{Desk, Place, lock};
use crate::error::{LaneError, LaneSendError, Loss};
use crate::frames::{FrameRx as AnyFrameRx, FrameTx as AnyFrameTx, weight};
use crate::handshake::HandshakeError;
use crate::latest::{LatestRx as AnyLatestRx, LatestTx as AnyLatestTx};
use crate::link::{Batching, Capabilities, Link, LinkConfig, Parts, PeerAddress, PeerInfo, Shared};
use crate::patience::Patience;
use crate::stats::Counters;
use trimaran_net::{Instant, Net};

/// The most messages of the frames lane that may wait for their reader, and that it may have taken at once:
/// 32 MiB of ids in all at the largest batch size.
const QUEUE: usize = 256;

const CAPABILITIES: Capabilities =
    Capabilities { reliable: true, ordered: true, encrypted: false, local: true };

/// Who listens in this process, by name.
static LISTENERS: LazyLock<Mutex<HashMap<Name, Weak<Desk>>>> = LazyLock::new(Mutex::default);

/// A listener's name; free again when this is dropped.
#[derive(Debug)]
pub(crate) struct Registered(Name);

impl Drop for Registered {
    fn drop(&mut self) {
        lock(&LISTENERS).remove(&self.0);
    }
}

/// Takes `name` for the listener at `desk`.
pub(crate) fn listen(name: &Name, desk: &Arc<Desk>) -> io::Result<Registered> {
    let mut listeners = lock(&LISTENERS);
    if listeners.contains_key(name) {
        return Err(io::ErrorKind::AddrInUse.into());
    }
    listeners.insert(name.clone(), Arc::downgrade(desk));
    Ok(Registered(name.clone()))
}

/// Makes a link with whoever listens as `name`.
pub(crate) async fn attempt(
    net: &Arc<dyn Net>,
    name: &Name,
    introduction: &Introduction<'_>,
) -> Result<Link, AttemptError> {
    let found = lock(&LISTENERS).get(name).and_then(Weak::upgrade);
    let desk = found.ok_or_else(|| AttemptError::Nobody { name: name.clone() })?;
    let Introduction { identity: ours, session, options, .. } = *introduction;
    let theirs = desk.identity;
    let place = desk.enter(&ours).map_err(|refusal| AttemptError::Handshake {
        address: name.to_string(),
        cause: HandshakeError::Refused(refusal),
    })?;
    let there = &desk.options.link;
    let (sent, taken) = Lanes::pair();
    let here = assemble(
        net,
        theirs,
        session,
        options.link.batching_between(&ours, &theirs),
        &options.link,
        sent,
        None,
    );
    let batching = there.batching_between(&theirs, &ours);
    desk.hand_out(assemble(&desk.net, ours, session, batching, there, taken, Some(place))).await;
    Ok(here)
}

/// Two links, each the other's peer: the first is `ours`, and has `theirs` at its other end.
///
/// # Errors
/// As a handshake would: when the two do not go together.
pub fn pair(
    net: &Arc<dyn Net>,
    ours: Identity,
    theirs: Identity,
    config: &LinkConfig,
) -> Result<(Link, Link), Refusal> {
    ours.admits(&theirs)?;
    let batching = config.batching_between(&ours, &theirs);
    let (here, there) = Lanes::pair();
    let make = |peer, lanes| assemble(net, peer, SessionId(0), batching, config, lanes, None);
    Ok((make(theirs, here), make(ours, there)))
}

/// One end of both lanes.
struct Lanes {
    latest: (LatestTx, LatestRx),
    frames: (FrameTx, FrameRx),
}

impl Lanes {
    /// Both ends.
    fn pair() -> (Self, Self) {
        let ((latest_a, frames_a), (latest_b, frames_b)) = (direction(), direction());
        (
            Self { latest: (latest_a.0, latest_b.1), frames: (frames_a.0, frames_b.1) },
            Self { latest: (latest_b.0, latest_a.1), frames: (frames_b.0, frames_a.1) },
        )
    }
}

/// Both lanes in one direction.
fn direction() -> ((LatestTx, LatestRx), (FrameTx, FrameRx)) {
    let (cell, view) = watch::channel(Cell::default());
    let (queue, messages) = queue::queue(QUEUE);
    (
        (LatestTx { cell }, LatestRx { view, seen: 0 }),
        (FrameTx { queue, staged: VecDeque::new() }, FrameRx { messages, farewell: None }),
    )
}

fn assemble(
    net: &Arc<dyn Net>,
    peer: Identity,
    session: SessionId,
    batching: Batching,
    config: &LinkConfig,
    Lanes { latest, frames }: Lanes,
    place: Option<Place>,
) -> Link {
    Parts {
        latest: (AnyLatestTx::Inproc(latest.0), AnyLatestRx::Inproc(latest.1)),
        frames: (AnyFrameTx::Inproc(frames.0), AnyFrameRx::Inproc(frames.1)),
        peer: PeerInfo { identity: peer, session, address: PeerAddress::InProcess },
        capabilities: CAPABILITIES,
        shared: Shared {
            peer: peer.role,
            counters: Counters::unframed(),
            _place: place.map(|place| Arc::new(place) as _),
        },
        batching,
    }
    .into_link(net, config)
}

/// What the latest lane holds.
#[derive(Debug, Default)]
struct Cell {
    camera: Option<Camera>,
    /// How many cameras were published: tells the reader whether it has seen this one.
    number: u64,
    farewell: Option<Goodbye>,
}

#[derive(Debug)]
pub(crate) struct LatestTx {
    cell: watch::Sender<Cell>,
}

impl LatestTx {
    pub(crate) fn publish(&mut self, camera: Camera, shared: &Shared) -> Result<(), LaneSendError> {
        if self.cell.is_closed() {
            return Err(LaneSendError::Lost(Loss::Closed));
        }
        shared.counters.sent.count(Kind::Camera, Camera::SIZE);
        self.cell.send_modify(|cell| {
            cell.camera = Some(camera);
            cell.number += 1;
        });
        Ok(())
    }

    pub(crate) fn goodbye(&mut self, reason: Goodbye, shared: &Shared) -> Result<(), LaneSendError> {
        if self.cell.is_closed() {
            return Err(LaneSendError::Lost(Loss::Closed));
        }
        shared.counters.sent.count(Kind::Goodbye, 0);
        self.cell.send_modify(|cell| cell.farewell = Some(reason));
        Ok(())
    }
}

#[derive(Debug)]
pub(crate) struct LatestRx {
    view: watch::Receiver<Cell>,
    seen: u64,
}

impl LatestRx {
    pub(crate) fn try_latest(&mut self, shared: &Shared) -> Result<Option<Camera>, LaneError> {
        // Asked before the look into the cell: what was published before the end must not be missed.
        let ended = self.view.has_changed().is_err();
        let cell = self.view.borrow_and_update();
        if cell.number != self.seen {
            self.seen = cell.number;
            shared.counters.received.count(Kind::Camera, Camera::SIZE);
            return Ok(cell.camera);
        }
        match &cell.farewell {
            Some(reason) => Err(LaneError::Goodbye(reason.clone())),
            None if ended => Err(LaneError::Lost(Loss::Closed)),
            None => Ok(None),
        }
    }

    pub(crate) async fn latest(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        patience: &mut Patience,
    ) -> Result<Camera, LaneError> {
        loop {
            if let Some(camera) = self.try_latest(shared)? {
                return Ok(camera);
            }
            // An end is found out by the next look.
            let _changed = patience.wait(by, self.view.changed()).await.map_err(LaneError::Expired)?;
        }
    }
}

#[derive(Debug)]
pub(crate) struct FrameTx {
    queue: queue::Sender<Message>,
    staged: VecDeque<Message>,
}

impl FrameTx {
    pub(crate) fn stage(&mut self, message: Message, shared: &Shared) {
        let (kind, bytes) = weight(&message);
        shared.counters.sent.count(kind, bytes);
        self.staged.push_back(message);
    }

    pub(crate) async fn send_staged(&mut self, patience: &mut Patience) -> Result<(), LaneSendError> {
        while !self.staged.is_empty() {
            let sent = patience.wait(None, self.queue.send(&mut self.staged)).await;
            sent.map_err(|_| LaneSendError::Stalled)?.map_err(|_gone| LaneSendError::Lost(Loss::Closed))?;
        }
        Ok(())
    }
}

#[derive(Debug)]
pub(crate) struct FrameRx {
    messages: queue::Receiver<Message>,
    farewell: Option<Goodbye>,
}

impl FrameRx {
    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        patience: &mut Patience,
    ) -> Result<Message, LaneError> {
        if let Some(reason) = &self.farewell {
            return Err(LaneError::Goodbye(reason.clone()));
        }
        let message = patience.wait(by, self.messages.recv()).await.map_err(LaneError::Expired)?;
        let message = message.ok_or(LaneError::Lost(Loss::Closed))?;
        let (kind, bytes) = weight(&message);
        shared.counters.received.count(kind, bytes);
        match message {
            Message::Goodbye(reason) => {
                self.farewell = Some(reason.clone());
                Err(LaneError::Goodbye(reason))
            }
            message => Ok(message),
        }
    }
}
