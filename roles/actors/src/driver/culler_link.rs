//! A culler's end at the display: what comes over its link, put together to frames.

use std::{
    collections::{HashSet, VecDeque},
    future::pending,
    sync::Arc,
    time::Duration,
};

use futures_util::{FutureExt, future::select_all};
use trimaran_proto::{Camera, DrawableId, RoleMessage, SentBytes, ViewVersion};
use trimaran_transport::{FrameOutcome, Instant, LinkStats, Net, RecvError};

use super::{
    close::left_early,
    error::{RoleError, link},
};
use crate::{
    clock::Stopwatch,
    deal::{CullerId, Disorder},
    ids::FrameIds,
    links::{FrameEvent, Link, MessageSender, sent_bytes},
    peers::{Arrival, Seat},
    supply::{DisplayEnd, Holdings, SupplyError},
};

/// A culler of a display.
#[derive(Debug)]
pub(super) struct CullerLink {
    pub(super) id: CullerId,
    pub(super) link: Link,
    /// Where another culler can reach it, if the display knows.
    pub(super) at: Option<String>,
    /// The view state that it was told of last.
    pub(super) told: ViewVersion,
    /// What it has no room for yet.
    unsaid: VecDeque<RoleMessage>,
    ids: FrameIds,
    /// Where the display has no scene.
    pub(super) supply: Option<DisplayEnd>,
    arriving: Option<Arriving>,
    /// What the link had carried at the end of the last frame.
    carried: LinkStats,
    /// Its place, which is free when this is dropped.
    _seat: Seat,
}

/// What came of a frame so far.
#[derive(Debug)]
struct Arriving {
    camera: Camera,
    begun: Duration,
    arrivals: Vec<(u32, Duration)>,
}

/// A frame that has been culled, and can be shown.
#[derive(Debug)]
pub(super) struct Culled {
    pub(super) camera: Camera,
    /// Who culled it; none if the display itself did.
    pub(super) by: Option<CullerId>,
    pub(super) ids: Vec<DrawableId>,
    /// Which of them are not all there, where the display has no scene.
    pub(super) lacking: Vec<DrawableId>,
    /// What can be shown in the place of these meanwhile, if coarser drawables may be.
    pub(super) stand_ins: Option<Vec<DrawableId>>,
    /// From when on it may be shown so.
    pub(super) may_lack_from: Option<Instant>,
    /// How many more it should have: they were lost on a link with deadlines.
    pub(super) missing: u32,
    /// When its begin arrived.
    pub(super) begun: Duration,
    /// How many ids had come, and when, since the begin.
    pub(super) arrivals: Vec<(u32, Duration)>,
    /// What travelled over the culler's link since its last frame.
    pub(super) traffic: SentBytes,
}

impl Culled {
    /// From when on it may be shown with what stands in for the rest, where that is there.
    pub(super) fn has_stand_ins_from(&self) -> Option<Instant> {
        self.may_lack_from.filter(|_| !self.lacking.is_empty() && self.stand_ins.is_some())
    }

    /// What can be drawn of it now, with what stands in for the rest.
    pub(super) fn there(&self) -> Vec<DrawableId> {
        let lacking: HashSet<_> = self.lacking.iter().collect();
        let ids = self.ids.iter().filter(|id| !lacking.contains(id));
        ids.chain(self.stand_ins.iter().flatten()).copied().collect()
    }
}

/// What a culler has to say.
#[derive(Debug)]
pub(super) enum Heard {
    /// A frame begins, culled from this camera.
    Began(Camera),
    /// All of it is there.
    Whole(Box<Culled>),
    /// Something beside frames.
    Said(RoleMessage),
    /// Nothing more: it left, or broke the rules.
    Gone(RoleError),
}

/// What the first of all cullers has to say. Never ends without any. Dropping the future loses nothing.
pub(super) async fn first_of(cullers: &mut [CullerLink], clock: &Stopwatch) -> (CullerId, Heard) {
    if cullers.is_empty() {
        pending::<()>().await;
    }
    let each = cullers.iter_mut().map(|culler| Box::pin(async { (culler.id, culler.hear(clock).await) }));
    select_all(each).await.0
}

impl CullerLink {
    pub(super) fn new(id: CullerId, Arrival { link, at, seat, .. }: Arrival, drawables: u32) -> Self {
        let (ids, carried) = (FrameIds::of(drawables), link.stats.read());
        let at = at.map(|at| at.to_string());
        Self {
            id,
            link,
            at,
            told: ViewVersion(0),
            unsaid: VecDeque::new(),
            ids,
            supply: None,
            arriving: None,
            carried,
            _seat: seat,
        }
    }

    /// Begins to take geometry from it.
    pub(super) fn take_supply(&mut self, net: &Arc<dyn Net>, holdings: &Arc<Holdings>) {
        let bulk = self.link.bulk.take();
        self.supply = bulk.map(|bulk| DisplayEnd::start(net, bulk, holdings));
    }

    /// The link alone.
    pub(super) async fn into_link(self) -> Link {
        let Self { mut link, supply, .. } = self;
        if let Some(supply) = supply {
            link.bulk = supply.give_back().await;
        }
        link
    }

    /// Tells it something as soon as it has room for that. Nobody waits for a culler that stalls.
    pub(super) fn say(&mut self, message: RoleMessage) {
        self.unsaid.push_back(message);
        // Who is gone is noticed where it is listened to.
        let _waits = say_all(&mut self.link.messages_tx, &mut self.unsaid).now_or_never();
    }

    /// Waits for what it says next. Dropping the future loses nothing.
    async fn hear(&mut self, clock: &Stopwatch) -> Heard {
        loop {
            // What is there without waiting came with what was before it.
            let (event, at_once) = match self.link.frames_rx.try_recv() {
                Ok(Some(event)) => (Ok(event), true),
                Err(end) => (Err(end), true),
                Ok(None) => tokio::select! {
                    biased;
                    event = self.link.frames_rx.recv() => (event, false),
                    said = self.link.messages_rx.recv() => match said {
                        Ok(said) => return Heard::Said(said),
                        Err(end) => (Err(end), false),
                    },
                    cause = failed(&mut self.supply) => {
                        let (peer, cause) = (self.id.to_string(), Box::new(cause));
                        return Heard::Gone(RoleError::Supplied { peer, cause });
                    }
                    () = say_all(&mut self.link.messages_tx, &mut self.unsaid) => continue,
                    end = left_early(&mut self.link.latest_rx) => (Err(end), false),
                },
            };
            let taken = match event {
                Ok(event) => self.take(event, at_once, clock.elapsed()),
                // It has nothing to say while it is dealt nothing.
                Err(RecvError::Silent { .. }) => Ok(None),
                Err(end) => Err(link("receiving a frame")(end)),
            };
            match taken {
                Ok(Some(heard)) => return heard,
                Ok(None) => {}
                Err(error) => return Heard::Gone(error),
            }
        }
    }

    fn take(&mut self, event: FrameEvent, at_once: bool, now: Duration) -> Result<Option<Heard>, RoleError> {
        let peer = self.id;
        let disorder = move |cause| RoleError::Order { peer: peer.to_string(), cause };
        match (event, &mut self.arriving) {
            (FrameEvent::Begin(start), None) => {
                let camera = start.header;
                self.arriving = Some(Arriving { camera, begun: now, arrivals: Vec::new() });
                Ok(Some(Heard::Began(camera)))
            }
            (FrameEvent::Batch(batch), Some(arriving)) => {
                let ids = self.ids.take(&batch);
                ids.map_err(|cause| RoleError::Ids { peer: peer.to_string(), cause })?;
                let (count, since) = (self.ids.count(), now.saturating_sub(arriving.begun));
                match arriving.arrivals.last_mut().filter(|_| at_once) {
                    Some((before, _)) => *before = count,
                    None => arriving.arrivals.push((count, since)),
                }
                Ok(None)
            }
            (FrameEvent::End(outcome), arriving) => {
                let Some(Arriving { camera, begun, arrivals }) = arriving.take() else {
                    return Err(disorder(Disorder::Unexpected("the end of a frame")));
                };
                let carried = self.link.stats.read();
                let since = carried - std::mem::replace(&mut self.carried, carried);
                Ok(Some(Heard::Whole(Box::new(Culled {
                    camera,
                    by: Some(peer),
                    ids: self.ids.finish(),
                    lacking: Vec::new(),
                    stand_ins: None,
                    may_lack_from: None,
                    missing: match outcome {
                        FrameOutcome::Complete(_) => 0,
                        FrameOutcome::Incomplete { expected, received, .. } => {
                            expected.saturating_sub(received).max(1)
                        }
                    },
                    begun,
                    arrivals,
                    traffic: sent_bytes(since.sent + since.received),
                }))))
            }
            (FrameEvent::Begin(_), Some(_)) => Err(disorder(Disorder::Unexpected("the begin of a frame"))),
            (FrameEvent::Batch(_), None) => Err(disorder(Disorder::Unexpected("a batch of ids"))),
        }
    }
}

/// Why what it sends cannot be taken. Never ends where nothing is sent. Dropping the future loses nothing.
async fn failed(supply: &mut Option<DisplayEnd>) -> SupplyError {
    match supply {
        Some(supply) => supply.failed().await,
        None => pending().await,
    }
}

/// Says all of it, in order. Never ends where nothing is to be said, or the peer is gone. Dropping the future
/// says each whole, or later.
async fn say_all(lane: &mut MessageSender, unsaid: &mut VecDeque<RoleMessage>) {
    if unsaid.is_empty() {
        pending::<()>().await;
    }
    while let Some(message) = unsaid.front() {
        if lane.send(message).await.is_err() {
            pending::<()>().await;
        }
        unsaid.pop_front();
    }
}
