//! Links within one process: nothing is encoded, ids are shared.

use std::collections::VecDeque;
use std::sync::Arc;

use tokio::sync::{mpsc, watch};
use trimaran_proto::{BatchSize, Camera, FrameMessage, Goodbye, Identity, Kind, Refusal, SessionId};

use crate::error::{LaneError, LaneSendError, Loss};
use crate::frames::{FrameRx as AnyFrameRx, FrameTx as AnyFrameTx, weight};
use crate::latest::{LatestRx as AnyLatestRx, LatestTx as AnyLatestTx};
use crate::link::{Link, LinkConfig, PeerAddress, PeerInfo, Shared};
use crate::net::{Instant, Net};
use crate::patience::Patience;
use crate::stats::Counters;
use crate::{FrameReceiver, FrameSender, LatestReceiver, LatestSender};

/// How many messages of the frames lane may wait for their reader: 32 MiB of ids at the largest batch size.
const QUEUE: usize = 512;

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
    let batch = config.batch_between(&ours, &theirs);
    let there = Lanes::new();
    let back = Lanes::new();
    let make = |peer, out: LanesTx, r#in: LanesRx| assemble(net, peer, batch, config, out, r#in);
    Ok((make(theirs, there.0, back.1), make(ours, back.0, there.1)))
}

/// Both lanes in one direction.
struct Lanes;
type LanesTx = (LatestTx, FrameTx);
type LanesRx = (LatestRx, FrameRx);

impl Lanes {
    #[expect(clippy::new_ret_no_self, reason = "a pair of ends is what there is")]
    fn new() -> (LanesTx, LanesRx) {
        let (cell, view) = watch::channel(Cell::default());
        let (queue, items) = mpsc::channel(QUEUE);
        (
            (LatestTx { cell }, FrameTx { queue, staged: VecDeque::new() }),
            (LatestRx { view, seen: 0 }, FrameRx { items, farewell: None }),
        )
    }
}

fn assemble(
    net: &Arc<dyn Net>,
    peer: Identity,
    batch: BatchSize,
    config: &LinkConfig,
    (latest_tx, frame_tx): LanesTx,
    (latest_rx, frame_rx): LanesRx,
) -> Link {
    let counters = Counters::unframed();
    let stats = counters.handle();
    let shared = || Shared { peer: peer.role, counters: Arc::clone(&counters), _place: None };
    let patience = || Patience::new(net, config.patience);
    Link {
        peer: PeerInfo { identity: peer, session: SessionId(0), address: PeerAddress::InProcess },
        latest_tx: LatestSender {
            lane: AnyLatestTx::Inproc(latest_tx),
            shared: shared(),
            patience: patience(),
        },
        latest_rx: LatestReceiver {
            lane: AnyLatestRx::Inproc(latest_rx),
            shared: shared(),
            patience: patience(),
        },
        frames_tx: FrameSender::new(batch, AnyFrameTx::Inproc(frame_tx), shared(), patience()),
        frames_rx: FrameReceiver::new(AnyFrameRx::Inproc(frame_rx), shared(), patience()),
        stats,
    }
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
enum Item {
    Frame(FrameMessage),
    Goodbye(Goodbye),
}

#[derive(Debug)]
pub(crate) struct FrameTx {
    queue: mpsc::Sender<Item>,
    staged: VecDeque<Item>,
}

impl FrameTx {
    pub(crate) fn stage(&mut self, message: FrameMessage, shared: &Shared) {
        let (kind, bytes) = weight(&message);
        shared.counters.sent.count(kind, bytes);
        self.staged.push_back(Item::Frame(message));
    }

    pub(crate) async fn send_staged(&mut self, patience: &mut Patience) -> Result<(), LaneSendError> {
        while !self.staged.is_empty() {
            let room = patience.wait(None, self.queue.reserve()).await.map_err(|_| LaneSendError::Stalled)?;
            let room = room.map_err(|_| LaneSendError::Lost(Loss::Closed))?;
            if let Some(item) = self.staged.pop_front() {
                room.send(item);
            }
        }
        Ok(())
    }

    pub(crate) async fn goodbye(
        &mut self,
        reason: Goodbye,
        shared: &Shared,
        patience: &mut Patience,
    ) -> Result<(), LaneSendError> {
        shared.counters.sent.count(Kind::Goodbye, 0);
        self.staged.push_back(Item::Goodbye(reason));
        self.send_staged(patience).await
    }
}

#[derive(Debug)]
pub(crate) struct FrameRx {
    items: mpsc::Receiver<Item>,
    farewell: Option<Goodbye>,
}

impl FrameRx {
    pub(crate) async fn next(
        &mut self,
        by: Option<Instant>,
        shared: &Shared,
        patience: &mut Patience,
    ) -> Result<FrameMessage, LaneError> {
        if let Some(reason) = &self.farewell {
            return Err(LaneError::Goodbye(reason.clone()));
        }
        match patience.wait(by, self.items.recv()).await.map_err(LaneError::Expired)? {
            Some(Item::Frame(message)) => {
                let (kind, bytes) = weight(&message);
                shared.counters.received.count(kind, bytes);
                Ok(message)
            }
            Some(Item::Goodbye(reason)) => {
                shared.counters.received.count(Kind::Goodbye, 0);
                self.farewell = Some(reason.clone());
                Err(LaneError::Goodbye(reason))
            }
            None => Err(LaneError::Lost(Loss::Closed)),
        }
    }
}
