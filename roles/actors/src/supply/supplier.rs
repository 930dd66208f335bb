//! A culler's geometry for a display that holds no scene: the selection, its order, and the amount in flight.

use std::{collections::VecDeque, sync::Arc};

use bytes::Bytes;
use thiserror::Error;
use trimaran_cull::{CutRule, View};
use trimaran_proto::{BulkError, Demand, DrawableId, FrameNumber, NumberList, Supply, ViewState, put_item};
use trimaran_scene::{DrawableEntry, ReadError, Scene};
use trimaran_transport::{Instant, MAX_BLOCK, SendError};

use super::{
    ahead::Ahead,
    held::Held,
    packed::Packed,
    queue::{Purpose, Queue},
    stand_ins::StandIns,
    window::{NotSent, Window},
};

/// How many drawables are prepared together: their records are packed as one.
const BATCH: usize = 64;
/// How many pieces of geometry are prepared ahead of need.
const AHEAD_BATCH: usize = 8;
/// A block with less room than this takes no part of a piece that does not end in it.
const LEAST_PART: usize = 256;
/// The most bytes of a part beside its content.
const PART_HEAD: usize = 24;

/// Why a culler cannot supply a display.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SupplyFault {
    /// The scene cannot be read.
    #[error("the display's geometry cannot be read")]
    Scene(#[source] ReadError),
    /// The display acknowledges something that was not sent.
    #[error("the display says that it has taken more geometry than it was sent")]
    NotSent,
    /// The display names something that the scene lacks.
    #[error("the display names {what} {number}, which is not in this scene")]
    Unknown {
        /// Its kind.
        what: &'static str,
        /// Its number.
        number: u32,
    },
    /// A bug.
    #[error("serving the display's geometry broke off: this is a fault of the program, and its log has more")]
    BrokeOff,
    /// The display's block cannot be read.
    #[error(transparent)]
    Block(#[from] BulkError),
    /// The display takes nothing.
    #[error("the display takes no geometry")]
    Lane(#[source] SendError),
}

/// The state of a display's geometry: present, missing and in flight.
#[derive(Debug)]
pub(crate) struct Supplier {
    scene: Arc<Scene>,
    packed: Packed,
    /// The rule for levels of detail; none before the first view state came.
    rule: Option<CutRule>,
    /// Whether the display has requested anything.
    has_begun: bool,
    /// Whether it follows another display: frames are not in its own numbers, so none is known to be shown.
    follows: bool,
    /// Whether it wants coarser drawables first.
    coarser_first: bool,
    /// The ids of the newest frame before that: the first camera may overtake the request.
    early: Vec<DrawableId>,
    view: Option<View>,
    /// The display's records of drawables, and its pieces of geometry.
    records: Held,
    geometries: Held,
    /// The drawables to send.
    queue: Queue,
    stand_ins: StandIns,
    ahead: Ahead,
    window: Window,
    /// Prepared to be sent: first items with the records that end in them, then pieces of geometry.
    ready: VecDeque<(Supply, Vec<Ending>)>,
    pieces: VecDeque<u32>,
    piece: Option<Piece>,
    /// The records and pieces that end in the block being made.
    ending: Vec<Ending>,
}

#[derive(Debug, Clone, Copy)]
enum Ending {
    Record(u32),
    Geometry(u32),
}

/// A piece of geometry that is being sent.
#[derive(Debug)]
struct Piece {
    number: u32,
    bytes: Bytes,
    sent: usize,
}

impl Supplier {
    pub(crate) fn new(scene: &Arc<Scene>, packed: &Packed) -> Self {
        Self {
            scene: Arc::clone(scene),
            packed: packed.clone(),
            rule: None,
            has_begun: false,
            follows: false,
            coarser_first: false,
            early: Vec::new(),
            view: None,
            records: Held::nothing_of(scene.drawables().len()),
            geometries: Held::nothing_of(scene.places().len()),
            queue: Queue::default(),
            stand_ins: StandIns::default(),
            ahead: Ahead::new(0),
            window: Window::new(),
            ready: VecDeque::new(),
            pieces: VecDeque::new(),
            piece: None,
            ending: Vec::new(),
        }
    }

    /// Whether the display has requested anything.
    pub(crate) const fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Uses this view state for frames from now on.
    pub(crate) fn change_view(&mut self, state: &ViewState) {
        self.rule = Some(CutRule::new(&self.scene, state));
    }

    /// The display follows another one from now on, or does no longer.
    pub(crate) const fn change_following(&mut self, follows: bool) {
        self.follows = follows;
    }

    /// These were found visible from `view`.
    pub(crate) fn found(&mut self, view: &View, ids: &[DrawableId], now: Instant) {
        if !self.has_begun {
            if self.view != Some(*view) {
                self.early.clear();
            }
            self.view = Some(*view);
            self.early.extend_from_slice(ids);
            return;
        }
        self.view = Some(*view);
        let frame = view.camera().frame();
        ids.iter().for_each(|id| self.need(frame, *id));
        self.ahead.found(&self.scene, view, ids, now);
    }

    /// Takes the display's demand.
    pub(crate) fn hear(&mut self, demand: Demand, now: Instant) -> Result<(), SupplyFault> {
        self.check(&demand)?;
        match demand {
            Demand::Begin { coarser_first, ahead } => self.begin(coarser_first, ahead, now),
            Demand::End => self.end(),
            Demand::Holds { drawables, geometries } => {
                drawables.iter().for_each(|id| self.records.insert(id));
                geometries.iter().for_each(|number| self.geometries.insert(number));
            }
            Demand::Lacks { frame, taken, drawables } => self.lacks(frame, taken, &drawables),
            Demand::Dropped { geometries } => {
                for number in geometries.iter() {
                    self.geometries.remove(number);
                    self.ahead.count_off(number);
                }
            }
            Demand::Taken { bytes } => {
                self.window.take(bytes, now).map_err(|NotSent| SupplyFault::NotSent)?;
            }
            Demand::Shown { frame } if !self.follows => self.queue.shown(frame),
            _ => {}
        }
        Ok(())
    }

    /// The next block, if one is to be sent now.
    pub(crate) fn next_block(&mut self, now: Instant) -> Result<Option<Bytes>, SupplyFault> {
        if !self.window.has_room() {
            return Ok(None);
        }
        let mut block = Vec::new();
        loop {
            self.make_ready(now)?;
            if let Some((item, ending)) = self.ready.front_mut() {
                if !put_item(&mut block, item) {
                    break;
                }
                self.ending.append(ending);
                self.ready.pop_front();
            } else if self.piece.is_some() {
                if !self.put_part(&mut block) {
                    break;
                }
            } else {
                break;
            }
        }
        if block.is_empty() {
            return Ok(None);
        }
        self.window.send(block.len() as u64, now);
        for ending in self.ending.drain(..) {
            let (ends, number) = match ending {
                Ending::Record(id) => (&mut self.records, id),
                Ending::Geometry(number) => (&mut self.geometries, number),
            };
            ends.sent(number, self.window.sent());
        }
        self.records.settle(self.window.taken());
        self.geometries.settle(self.window.taken());
        Ok(Some(block.into()))
    }

    /// Checks that the named records and pieces exist, and were sent.
    fn check(&self, demand: &Demand) -> Result<(), SupplyFault> {
        let none = NumberList::default();
        let (drawables, geometries, taken) = match demand {
            Demand::Holds { drawables, geometries } => (drawables, geometries, 0),
            Demand::Lacks { drawables, taken, .. } => (drawables, &none, *taken),
            Demand::Dropped { geometries } => (&none, geometries, 0),
            _ => return Ok(()),
        };
        if taken > self.window.sent() {
            return Err(SupplyFault::NotSent);
        }
        for (what, known, named) in
            [("drawable", &self.records, drawables), ("piece of geometry", &self.geometries, geometries)]
        {
            if let Some(number) = known.stranger(named.iter()) {
                return Err(SupplyFault::Unknown { what, number });
            }
        }
        Ok(())
    }

    fn begin(&mut self, coarser_first: bool, ahead: u64, now: Instant) {
        self.has_begun = true;
        self.coarser_first = coarser_first;
        self.ahead = Ahead::new(ahead);
        if let Some(view) = self.view {
            let early = std::mem::take(&mut self.early);
            self.found(&view, &early, now);
        }
    }

    /// Sends only the rest of what was begun, and forgets the display's holdings.
    fn end(&mut self) {
        self.has_begun = false;
        self.records.clear();
        self.geometries.clear();
        self.queue.clear();
        self.stand_ins = StandIns::default();
        self.ahead = Ahead::new(0);
        self.ready.clear();
        self.pieces.clear();
    }

    /// Sends a drawable for a frame, unless the display has it or it is on its way.
    fn need(&mut self, frame: FrameNumber, id: DrawableId) {
        let frame = if self.follows { FrameNumber(u32::MAX) } else { frame };
        if self.scene.drawables().get(id.index()).is_none() || self.has(id) || self.queue.renew(id, frame) {
            return;
        }
        self.queue.push(id, frame, Purpose::Shows, self.size(id));
        if self.coarser_first {
            self.stand_ins.add(id, frame);
        }
    }

    /// Whether the display has it, or it is on its way.
    fn has(&self, id: DrawableId) -> bool {
        let drawable = self.scene.drawables().get(id.index());
        drawable.is_some_and(|drawable| {
            self.records.contains(id.0) && self.geometries.contains(drawable.geometry)
        })
    }

    /// About its size on the screen, squared.
    fn size(&self, id: DrawableId) -> f64 {
        self.scene.part(id).zip(self.view).map_or(0.0, |((_, part), view)| {
            let (min, max) = part.world_box();
            (max - min).length_squared() / part.distance_squared(view.eye()).max(1e-6)
        })
    }

    /// Finds stand-ins for new drawables, which come first, and tells the display.
    fn find_stand_ins(&mut self) {
        let (Some(view), Some(rule)) = (self.view, self.rule.clone()) else { return };
        let mut stand_ins = std::mem::take(&mut self.stand_ins);
        for (id, frame) in stand_ins.find(&self.scene, &view, &rule, |id| self.has(id)) {
            self.queue.push(id, frame, Purpose::StandsIn, self.size(id));
        }
        self.ready.extend(stand_ins.tell().into_iter().map(|item| (item, Vec::new())));
        self.stand_ins = stand_ins;
    }

    fn lacks(&mut self, frame: FrameNumber, taken: u64, drawables: &NumberList) {
        for id in drawables.iter().map(DrawableId) {
            let Some(drawable) = self.scene.drawables().get(id.index()) else { continue };
            // Drawables that ended later may still arrive.
            if self.records.had_ended(id.0, taken) && self.geometries.had_ended(drawable.geometry, taken) {
                self.records.remove(id.0);
                self.geometries.remove(drawable.geometry);
            }
            self.need(frame, id);
        }
    }

    /// Prepares the next drawables, if nothing else is ready.
    fn make_ready(&mut self, now: Instant) -> Result<(), SupplyFault> {
        if !self.ready.is_empty() || self.piece.is_some() {
            return Ok(());
        }
        if self.pieces.is_empty() {
            self.find_stand_ins();
            self.take_batch()?;
        }
        if self.pieces.is_empty() && self.ready.is_empty() {
            self.take_ahead(now)?;
        }
        if self.ready.is_empty()
            && let Some(number) = self.pieces.pop_front()
        {
            let bytes = self.packed.piece(&self.scene, number).map_err(SupplyFault::Scene)?;
            self.piece = Some(Piece { number, bytes, sent: 0 });
        }
        Ok(())
    }

    /// Stand-ins and other drawables are not mixed in a batch.
    fn take_batch(&mut self) -> Result<(), SupplyFault> {
        let mut entries = Vec::new();
        let mut taken = 0;
        let purpose = self.queue.purpose();
        while taken < BATCH
            && self.queue.purpose() == purpose
            && let Some(id) = self.queue.pop()
        {
            taken += 1;
            self.take(id, &mut entries)?;
        }
        self.pack_in_order(entries)
    }

    /// Prepares geometry ahead of need, while next to nothing is in flight.
    fn take_ahead(&mut self, now: Instant) -> Result<(), SupplyFault> {
        let Some(rule) = self.rule.clone().filter(|_| self.window.is_quiet()) else { return Ok(()) };
        let (mut entries, mut numbers) = (Vec::new(), Vec::new());
        while numbers.len() < AHEAD_BATCH
            && let Some(id) = self.ahead.pop(&self.scene, &rule, now)
        {
            if let Some(number) = self.take(id, &mut entries)? {
                let bytes = self.scene.places().get(number as usize).map_or(0, |place| place.length.into());
                self.ahead.sent(number, bytes, now);
                numbers.push(number);
            }
        }
        if !numbers.is_empty() {
            let geometries = NumberList::of(numbers);
            self.ready.push_back((Supply::Ahead { geometries }, Vec::new()));
        }
        self.pack_in_order(entries)
    }

    /// Prepares the missing parts of a drawable. Returns the piece of geometry, if that is to be sent.
    fn take(&mut self, id: DrawableId, entries: &mut Vec<DrawableEntry>) -> Result<Option<u32>, SupplyFault> {
        let entry = DrawableEntry::of(&self.scene, id).map_err(SupplyFault::Scene)?;
        let Some(entry) = entry else { return Ok(None) };
        if self.records.send(id.0) {
            entries.push(entry);
        }
        if !self.geometries.send(entry.geometry) {
            return Ok(None);
        }
        self.pieces.push_back(entry.geometry);
        Ok(Some(entry.geometry))
    }

    fn pack_in_order(&mut self, mut entries: Vec<DrawableEntry>) -> Result<(), SupplyFault> {
        // Sorted records pack better.
        entries.sort_unstable_by_key(|entry| entry.id);
        self.pack(&entries)
    }

    /// Packs records, in as many items as fit into a block each.
    fn pack(&mut self, entries: &[DrawableEntry]) -> Result<(), SupplyFault> {
        if entries.is_empty() {
            return Ok(());
        }
        let packed = self.packed.records(entries).map_err(SupplyFault::Scene)?;
        if packed.len() + PART_HEAD > MAX_BLOCK && entries.len() > 1 {
            let (first, second) = entries.split_at(entries.len() / 2);
            self.pack(first)?;
            self.pack(second)?;
        } else {
            let ending = entries.iter().map(|entry| Ending::Record(entry.id)).collect();
            self.ready.push_back((Supply::Entries { packed }, ending));
        }
        Ok(())
    }

    /// Puts as much of the piece into the block as fits. Returns false if nothing does.
    fn put_part(&mut self, block: &mut Vec<u8>) -> bool {
        let Some(piece) = &mut self.piece else { return false };
        let room = MAX_BLOCK.saturating_sub(block.len() + PART_HEAD);
        let rest = piece.bytes.slice(piece.sent.min(piece.bytes.len())..);
        if room < rest.len() && room < LEAST_PART {
            return false;
        }
        let part = rest.slice(..room.min(rest.len()));
        let sent = part.len();
        let (length, offset) = (piece.bytes.len() as u32, piece.sent as u32);
        if !put_item(block, &Supply::Geometry { number: piece.number, length, offset, part }) {
            return false;
        }
        piece.sent += sent;
        if piece.sent == piece.bytes.len() {
            self.ending.push(Ending::Geometry(piece.number));
            self.piece = None;
        }
        true
    }
}

#[cfg(test)]
#[path = "supplier_tests.rs"]
mod tests;
