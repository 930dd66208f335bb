//! A culler's link at the display: assembles its messages to frames.

use std::{
    collections::{HashSet, VecDeque},
    future::pending,
    sync::Arc,
    time::Duration,
};

use futures_util::{
    FutureExt,
    future::{OptionFuture, select_all},
};
use trimaran_proto::{Camera, DrawableId, RoleMessage, SentBytes, ViewVersion};
use trimaran_transport::{FrameOutcome, Instant, LinkStats, Net};

use super::{
    close::left_early,
    error::{RoleError, link},
};
use crate::{
    choice::Mode,
    clock::Stopwatch,
    deal::{CullerId, Disorder},
    ids::FrameIds,
    links::{FrameEvent, Link, MessageSender, sent_bytes},
    peers::{Arrival, SlotGuard},
    supply::{DisplayEnd, Holdings},
};

/// A culler of a display.
#[derive(Debug)]
pub(super) struct CullerLink {
    pub(super) id: CullerId,
    pub(super) link: Link,
    /// Its endpoint for another culler, if the display knows one.
    pub(super) at: Option<String>,
    /// The last view state sent to it.
    pub(super) told: ViewVersion,
    /// Messages waiting for room.
    unsaid: VecDeque<RoleMessage>,
    ids: FrameIds,
    /// If the display has no scene.
    pub(super) supply: Option<DisplayEnd>,
    arriving: Option<Arriving>,
    /// The link's traffic at the end of the last frame.
    carried: LinkStats,
    /// Its slot, free on drop.
    _slot: SlotGuard,
}

/// The received part of a frame.
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
    /// Its culler; none if the display itself culled it.
    pub(super) by: Option<CullerId>,
    pub(super) ids: Vec<DrawableId>,
    /// Those of them that are not complete, if the display has no scene.
    pub(super) lacking: Vec<DrawableId>,
    /// Stand-ins for these, if coarser drawables may be shown meanwhile.
    pub(super) stand_ins: Option<Vec<DrawableId>>,
    /// From when it may be shown with stand-ins.
    pub(super) may_lack_from: Option<Instant>,
    /// How many ids were lost on a link with deadlines.
    pub(super) missing: u32,
    /// When its begin arrived.
    pub(super) begun: Duration,
    /// Pairs of an id count and the time since the begin.
    pub(super) arrivals: Vec<(u32, Duration)>,
    /// The traffic of the culler's link since its last frame.
    pub(super) traffic: SentBytes,
    /// How the display itself found the ids, if it may choose.
    pub(super) found: Option<FoundAlone>,
}

/// How a display found a frame's drawables, and what that cost.
#[derive(Debug, Clone, Copy)]
pub(super) struct FoundAlone {
    pub(super) mode: Mode,
    /// The time until they were found, nanoseconds.
    pub(super) took: u64,
    /// The cost of the whole frame by counts, nanoseconds.
    pub(super) counted: u64,
}

impl Culled {
    /// The display itself culled it.
    pub(super) fn alone(camera: Camera, ids: Vec<DrawableId>, begun: Duration) -> Self {
        Self {
            camera,
            by: None,
            ids,
            lacking: Vec::new(),
            stand_ins: None,
            may_lack_from: None,
            missing: 0,
            begun,
            arrivals: Vec::new(),
            traffic: SentBytes::default(),
            found: None,
        }
    }

    /// From when it may be shown with stand-ins, if there are any.
    pub(super) fn has_stand_ins_from(&self) -> Option<Instant> {
        self.may_lack_from.filter(|_| !self.lacking.is_empty() && self.stand_ins.is_some())
    }

    /// The drawables to show now, with stand-ins for missing ones.
    pub(super) fn there(&self) -> Vec<DrawableId> {
        let lacking: HashSet<_> = self.lacking.iter().collect();
        let ids = self.ids.iter().filter(|id| !lacking.contains(id));
        ids.chain(self.stand_ins.iter().flatten()).copied().collect()
    }
}

/// An event of a culler.
#[derive(Debug)]
pub(super) enum Heard {
    /// A frame begins, culled from this camera.
    Began(Camera),
    /// All of the frame has arrived.
    Whole(Box<Culled>),
    /// Another message.
    Message(RoleMessage),
    /// It left, or broke the protocol.
    Gone(RoleError),
}

/// The first event of any culler. Pending for ever without cullers. Dropping the future loses nothing.
pub(super) async fn first_of(cullers: &mut [CullerLink], clock: &Stopwatch) -> (CullerId, Heard) {
    if cullers.is_empty() {
        pending::<()>().await;
    }
    let each = cullers.iter_mut().map(|culler| Box::pin(async { (culler.id, culler.hear(clock).await) }));
    select_all(each).await.0
}

impl CullerLink {
    pub(super) fn new(id: CullerId, Arrival { link, at, slot, .. }: Arrival, drawables: u32) -> Self {
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
            _slot: slot,
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

    /// Sends it a message once it has room. A stalled culler is not waited for.
    pub(super) fn say(&mut self, message: RoleMessage) {
        self.unsaid.push_back(message);
        // A lost culler is noticed by its receiver.
        let _waits = say_all(&mut self.link.messages_tx, &mut self.unsaid).now_or_never();
    }

    /// Waits for its next event. Dropping the future loses nothing.
    async fn hear(&mut self, clock: &Stopwatch) -> Heard {
        loop {
            // A message available without waiting arrived together with the one before.
            let (event, at_once) = match self.link.frames_rx.try_recv() {
                Ok(Some(event)) => (Ok(event), true),
                Err(end) => (Err(end), true),
                Ok(None) => tokio::select! {
                    biased;
                    event = self.link.frames_rx.recv() => (event, false),
                    message = self.link.messages_rx.recv() => match message {
                        Ok(message) => return Heard::Message(message),
                        Err(end) => (Err(end), false),
                    },
                    Some(cause) = OptionFuture::from(self.supply.as_mut().map(DisplayEnd::failed)) => {
                        let (peer, cause) = (self.id.to_string(), Box::new(cause));
                        return Heard::Gone(RoleError::Supplied { peer, cause });
                    }
                    () = say_all(&mut self.link.messages_tx, &mut self.unsaid) => continue,
                    end = left_early(&mut self.link.latest_rx) => (Err(end), false),
                },
            };
            let taken = match event {
                Ok(event) => self.take(event, at_once, clock.elapsed()),
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
                    by: Some(peer),
                    missing: match outcome {
                        FrameOutcome::Complete(_) => 0,
                        FrameOutcome::Incomplete { expected, received, .. } => {
                            expected.saturating_sub(received).max(1)
                        }
                    },
                    arrivals,
                    traffic: sent_bytes(since.sent + since.received),
                    ..Culled::alone(camera, self.ids.finish(), begun)
                }))))
            }
            (FrameEvent::Begin(_), Some(_)) => Err(disorder(Disorder::Unexpected("the begin of a frame"))),
            (FrameEvent::Batch(_), None) => Err(disorder(Disorder::Unexpected("a batch of ids"))),
        }
    }
}

/// Sends all messages, in order. Pending for ever if there are none, or the peer is gone. Dropping the future
/// leaves whole messages for later.
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
