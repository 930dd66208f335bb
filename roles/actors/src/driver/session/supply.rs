//! A display without a scene: the missing geometry of its frames, and the culler that supplies it.

use std::{sync::Arc, time::Duration};

use trimaran_proto::{CloseCode, DrawableId, FrameNumber};
use trimaran_scene::GiveError;
use trimaran_transport::{Instant, sleep_until};

use super::super::{
    close::leave,
    culler::CullerWork,
    culler_link::{Culled, CullerLink},
    display::{DisplayWork, Supplied, WhileLoading},
    error::RoleError,
};
use super::{Loading, Session};
use crate::{
    deal::{CullerId, Pace},
    peers::Arrival,
    supply::{DisplayEnd, Holdings, SupplyError},
};

/// How long a supplier may send nothing of the missing geometry before another culler takes over.
const PATIENCE: Duration = Duration::from_secs(2);
/// How long the slot of a culler of another scene stays taken.
const PAUSE: Duration = Duration::from_secs(5);
/// How many bytes may come before a frame needs them, unless the cache is smaller. Per ten seconds, so that
/// useless ones take little bandwidth.
const AHEAD: u64 = 256 << 10;
/// How long a live frame waits to be complete before it is shown with stand-ins. Usually the rest follows at
/// once, and needless changes of level would be visible.
const GRACE: Duration = Duration::from_millis(5);
/// The most frames that wait for their geometry in a live session: the first ones and the newest.
const WAITING: usize = 8;

/// The geometry of a display that was given no scene, and its supplier.
#[derive(Debug)]
pub(super) struct Supplies {
    pub(super) holdings: Arc<Holdings>,
    /// Whether stand-ins may be shown for missing geometry.
    coarser_first: bool,
    /// How many bytes may come before a frame needs them.
    ahead: u64,
    supplier: Option<CullerId>,
    /// When geometry last came, or the supplier was chosen.
    heard: Instant,
}

impl Supplies {
    pub(super) fn new(supplied: &Supplied, pace: Pace, now: Instant) -> Self {
        let holdings = Arc::new(Holdings::new(&supplied.scene, supplied.memory));
        let coarser_first = pace == Pace::Live && supplied.while_loading == WhileLoading::Coarser;
        let ahead = AHEAD.min(supplied.memory / 4);
        Self { holdings, coarser_first, ahead, supplier: None, heard: now }
    }

    /// Determines anew the missing drawables of a frame, and their stand-ins.
    fn look(&self, culled: &mut Culled) -> Result<(), GiveError> {
        culled.lacking = self.holdings.lacking(&culled.ids)?;
        self.look_for_stand_ins(culled)
    }

    /// The same, if nothing was evicted since.
    fn look_again(&self, culled: &mut Culled) -> Result<(), GiveError> {
        culled.lacking = self.holdings.lacking(&culled.lacking)?;
        self.look_for_stand_ins(culled)
    }

    fn look_for_stand_ins(&self, culled: &mut Culled) -> Result<(), GiveError> {
        culled.stand_ins = match self.coarser_first && !culled.lacking.is_empty() {
            true => self.holdings.stand_ins(&culled.lacking)?,
            false => None,
        };
        Ok(())
    }
}

impl<W: DisplayWork, A: CullerWork> Session<'_, W, A> {
    /// A frame is whole: it can be shown once all its geometry, or stand-ins for the rest, have arrived.
    pub(super) fn note_whole(
        &mut self,
        frame: FrameNumber,
        mut culled: Culled,
        now: Instant,
    ) -> Result<(), SupplyError> {
        if let Some(supplies) = &self.supplies {
            culled.may_lack_from = supplies.coarser_first.then(|| now.after(GRACE));
            let supplier = find(&self.cullers, supplies.supplier);
            let taken = supplier.map_or(0, |supplier| supplier.taken());
            supplies.look(&mut culled)?;
            if let Some(supplier) = supplier {
                supplier.lacks(frame, taken, &culled.lacking);
            }
        }
        self.there.insert(frame, culled);
        if self.supplies.is_some() && self.role.pace == Pace::Live {
            // The first one is complete first, and the newest is the most wanted.
            while self.there.len() > WAITING {
                let middle = self.there.keys().nth(WAITING / 2).copied();
                middle.and_then(|frame| self.there.remove(&frame));
            }
        }
        Ok(())
    }

    /// The frame to show now, if any: in lockstep the next one, live the newest.
    pub(super) fn due(&self) -> Option<FrameNumber> {
        let due = self.dealer.due()?;
        if self.supplies.is_none() {
            return Some(due);
        }
        let now = self.role.net.now();
        let can_be_shown = |culled: &&Culled| {
            culled.lacking.is_empty() || culled.has_stand_ins_from().is_some_and(|from| from <= now)
        };
        match self.role.pace {
            Pace::Lockstep { .. } => self.there.get(&due).filter(can_be_shown).map(|_| due),
            Pace::Live => {
                self.there.iter().rev().find(|(_, culled)| can_be_shown(culled)).map(|(frame, _)| *frame)
            }
        }
    }

    /// When a frame can be shown with stand-ins.
    pub(super) fn stands_in(&self) -> Option<Instant> {
        self.there.values().filter_map(Culled::has_stand_ins_from).min()
    }

    /// Whether enough of the last shown frame has come to draw it again: all of it, or half of its missing
    /// drawables.
    pub(super) fn has_more(&self) -> bool {
        self.loading.as_ref().is_some_and(|Loading { culled, lacked, .. }| {
            let lacks = culled.lacking.len();
            lacks == 0 || culled.stand_ins.is_some() && 2 * lacks <= *lacked
        })
    }

    /// Geometry has come.
    pub(super) fn note_supplied(&mut self, now: Instant) -> Result<(), SupplyError> {
        let Some(supplies) = &mut self.supplies else { return Ok(()) };
        supplies.heard = now;
        let loading = self.loading.iter_mut().map(|loading| &mut loading.culled);
        for culled in self.there.values_mut().chain(loading).filter(|culled| !culled.lacking.is_empty()) {
            supplies.look_again(culled)?;
        }
        self.trim()
    }

    /// A frame was shown: tells the supplier, and evicts geometry beyond the budget.
    pub(super) fn note_shown(&mut self, frame: FrameNumber) -> Result<(), RoleError> {
        let Some(supplies) = &self.supplies else { return Ok(()) };
        // Until it is exact, only earlier frames need nothing more.
        let exact =
            if self.loading.is_none() { Some(frame) } else { frame.0.checked_sub(1).map(FrameNumber) };
        if let Some((supplier, exact)) = find(&self.cullers, supplies.supplier).zip(exact) {
            supplier.shown(exact);
        }
        // Received geometry was valid, and frames consist of received geometry.
        self.trim()
            .map_err(|cause| RoleError::Supplied { peer: "supplier".to_owned(), cause: Box::new(cause) })
    }

    /// Evicts geometry beyond the budget, but none of the next frame. Other frames request theirs again.
    fn trim(&mut self) -> Result<(), SupplyError> {
        let Some(supplies) = &self.supplies else { return Ok(()) };
        let waits = self.there.values().next().or_else(|| Some(&self.loading.as_ref()?.culled));
        let stand_ins = waits.and_then(|culled| culled.stand_ins.as_deref()).unwrap_or_default();
        let dropped = supplies.holdings.trim(&[waits.map_or(&self.last, |culled| &culled.ids), stand_ins]);
        if dropped.is_empty() {
            return Ok(());
        }
        let supplier = find(&self.cullers, supplies.supplier);
        if let Some(supplier) = supplier {
            supplier.dropped(&dropped);
        }
        let taken = supplier.map_or(0, |supplier| supplier.taken());
        let loading = self.loading.iter_mut().map(|loading| (loading.frame, &mut loading.culled));
        for (frame, culled) in self.there.iter_mut().map(|(frame, culled)| (*frame, culled)).chain(loading) {
            supplies.look(culled)?;
            if let Some(supplier) = supplier {
                supplier.lacks(frame, taken, &culled.lacking);
            }
        }
        Ok(())
    }

    /// Frames with missing geometry.
    fn lacking(&self) -> impl Iterator<Item = (FrameNumber, &Culled)> {
        let loading = self.loading.iter().map(|loading| (loading.frame, &loading.culled));
        let waiting = self.there.iter().map(|(frame, culled)| (*frame, culled));
        waiting.chain(loading).filter(|(_, culled)| !culled.lacking.is_empty())
    }

    /// Ensures that one of the present cullers supplies the display.
    pub(super) fn choose_supplier(&mut self, now: Instant) {
        let Some(supplies) = &self.supplies else { return };
        if find(&self.cullers, supplies.supplier).is_none() {
            self.next_supplier(now);
        }
    }

    /// When another culler takes over the supply, if nothing comes until then.
    pub(super) fn supplier_late(&self) -> Option<Instant> {
        let supplies = self.supplies.as_ref()?;
        let waits = self.lacking().next().is_some();
        let others = self.cullers.iter().filter(|culler| culler.supply.is_some()).count() > 1;
        (waits && others).then(|| supplies.heard.after(PATIENCE))
    }

    /// Lets another culler supply the display.
    pub(super) fn change_supplier(&mut self, now: Instant) {
        let supplier = self.supplies.as_ref().and_then(|supplies| supplies.supplier);
        tracing::warn!(id = ?supplier, "sends nothing of what is lacking: another one supplies the display");
        if let Some(supplier) = find(&self.cullers, supplier) {
            supplier.end();
        }
        self.next_supplier(now);
    }

    /// The next one takes over, round-robin.
    fn next_supplier(&mut self, now: Instant) {
        let Some(supplies) = &mut self.supplies else { return };
        let before = supplies.supplier;
        let able = self.cullers.iter().filter(|culler| culler.supply.is_some());
        let next = able.min_by_key(|culler| (before.is_some_and(|before| culler.id <= before), culler.id));
        supplies.heard = now;
        supplies.supplier = next.map(|culler| culler.id);
        let Some(supplier) = next.and_then(|culler| culler.supply.as_ref()) else { return };
        tracing::debug!(id = ?supplies.supplier, "supplies the display");
        supplier.begin(&supplies.holdings, supplies.coarser_first, supplies.ahead);
        let taken = supplier.taken();
        for (frame, culled) in self.lacking() {
            supplier.lacks(frame, taken, &culled.lacking);
        }
    }

    /// The received geometry is unusable: the supplier is dropped.
    pub(super) fn lose_supplier(&mut self, cause: SupplyError) {
        let supplier = self.supplies.as_ref().and_then(|supplies| supplies.supplier);
        if cause.doubts_what_is_there() {
            let peer = supplier.map_or_else(|| "culler".to_owned(), |id| id.to_string());
            self.failed = Some(RoleError::Supplied { peer, cause: Box::new(cause) });
        } else if let Some(id) = supplier {
            self.lose(id, RoleError::Supplied { peer: id.to_string(), cause: Box::new(cause) });
        }
    }

    /// Why a culler cannot serve this display: it holds another scene than the first one did.
    pub(super) fn foreign_scene(&self, arrival: &Arrival) -> Option<String> {
        let ours = self.role.supplied.as_ref()?.scene.outline();
        let theirs = arrival.link.peer.hello.scene;
        (theirs != Some(ours)).then(|| match theirs {
            Some(theirs) => format!("it holds scene {}, and this display shows {}", theirs.hash, ours.hash),
            None => "it holds no scene".to_owned(),
        })
    }

    /// Tells a culler why it is rejected. Its slot is freed after a pause: it may be restarted with another
    /// scene.
    pub(super) fn turn_away(&self, Arrival { link, slot, .. }: Arrival, why: &str) {
        let (net, reason) = (Arc::clone(&self.role.net), CloseCode::Failed.because(why));
        self.role.net.spawn(Box::pin(async move {
            leave(vec![link], reason).await;
            sleep_until(&*net, net.now().after(PAUSE)).await;
            drop(slot);
        }));
    }

    /// The session is over.
    pub(in crate::driver) fn tell_ahead_use(&mut self) {
        if let Some(supplies) = &self.supplies {
            self.observer.ahead(&supplies.holdings.ahead_use());
        }
    }

    /// A frame of these is drawn now.
    pub(super) fn note_drawn(&self, ids: &[DrawableId]) {
        if let Some(supplies) = &self.supplies {
            supplies.holdings.used(ids);
        }
    }
}

/// The end of the supplier's bulk lane.
fn find(cullers: &[CullerLink], supplier: Option<CullerId>) -> Option<&DisplayEnd> {
    let id = supplier?;
    cullers.iter().find(|culler| culler.id == id)?.supply.as_ref()
}
