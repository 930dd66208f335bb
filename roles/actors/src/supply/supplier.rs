//! What a culler has to send to a display that holds no scene: which, in which order, and how much at once.

use std::{
    cmp::Ordering,
    collections::{BinaryHeap, HashMap, VecDeque, hash_map::Entry},
    sync::Arc,
};

use bytes::Bytes;
use thiserror::Error;
use trimaran_cull::View;
use trimaran_proto::{BulkError, Demand, DrawableId, FrameNumber, NumberList, Supply, put_item};
use trimaran_scene::{DrawableEntry, ReadError, Scene, pack_entries};
use trimaran_transport::{Instant, MAX_BLOCK, SendError};

use super::window::{NotSent, Window};

/// How many drawables are made ready together: their records are packed as one.
const BATCH: usize = 64;
/// A block with fewer bytes left than this takes no part of a piece that does not end in it.
const LEAST_PART: usize = 256;
/// The bytes of a part beside its content, at most.
const PART_HEAD: usize = 24;
/// Of what is on its way nobody knows yet where it ends.
const NOT_YET: u64 = u64::MAX;

/// Why a culler cannot supply a display.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SupplyFault {
    /// The scene cannot be read.
    #[error("the display's geometry cannot be read")]
    Scene(#[source] ReadError),
    /// The display says that it has taken what it was not sent.
    #[error("the display says that it has taken more geometry than it was sent")]
    NotSent,
    /// What the display says cannot be read.
    #[error(transparent)]
    Block(#[from] BulkError),
    /// The display takes nothing.
    #[error("the display takes no geometry")]
    Lane(#[source] SendError),
}

/// What of a scene a display has, lacks, and is being sent.
#[derive(Debug)]
pub(crate) struct Supplier {
    scene: Arc<Scene>,
    /// Whether the display has asked for anything.
    has_begun: bool,
    /// What was found in the newest frame before that: the first camera may overtake the request.
    early: Vec<DrawableId>,
    view: Option<View>,
    /// Where in all that was sent the record of a drawable ended, and its geometry; 0 for what the display
    /// had. What ended at or before what the display has taken is there, unless the display says otherwise.
    records: HashMap<u32, u64>,
    geometries: HashMap<u32, u64>,
    /// What is to be sent, and for which frame it is needed last.
    due: HashMap<DrawableId, FrameNumber>,
    order: BinaryHeap<Due>,
    shown: Option<FrameNumber>,
    window: Window,
    /// Made ready, and first to be sent: items and what ends with them, then pieces of geometry.
    ready: VecDeque<(Supply, Vec<Ending>)>,
    pieces: VecDeque<u32>,
    piece: Option<Piece>,
    /// What ends in the block that is being made.
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

/// A drawable by how soon it is to be sent: what looks largest first.
#[derive(Debug, Clone, Copy)]
struct Due {
    /// About its size on the screen, squared.
    size: f64,
    id: DrawableId,
}

impl Supplier {
    pub(crate) fn new(scene: &Arc<Scene>) -> Self {
        Self {
            scene: Arc::clone(scene),
            has_begun: false,
            early: Vec::new(),
            view: None,
            records: HashMap::new(),
            geometries: HashMap::new(),
            due: HashMap::new(),
            order: BinaryHeap::new(),
            shown: None,
            window: Window::new(),
            ready: VecDeque::new(),
            pieces: VecDeque::new(),
            piece: None,
            ending: Vec::new(),
        }
    }

    /// These were found visible from `view`. Gives whether some of them are to be sent.
    pub(crate) fn found(&mut self, view: &View, ids: &[DrawableId]) -> bool {
        if !self.has_begun {
            if self.view != Some(*view) {
                self.early.clear();
            }
            self.view = Some(*view);
            self.early.extend_from_slice(ids);
            return false;
        }
        self.view = Some(*view);
        let before = self.order.len();
        let frame = view.camera().frame();
        ids.iter().for_each(|id| self.need(frame, *id));
        self.order.len() > before
    }

    /// Takes what the display says.
    pub(crate) fn hear(&mut self, demand: Demand, now: Instant) -> Result<(), SupplyFault> {
        match demand {
            Demand::Begin => self.begin(),
            Demand::End => self.end(),
            Demand::Holds { drawables, geometries } => {
                self.records.extend(drawables.iter().map(|id| (id, 0)));
                self.geometries.extend(geometries.iter().map(|number| (number, 0)));
            }
            Demand::Lacks { frame, taken, drawables } => self.lacks(frame, taken, &drawables),
            Demand::Dropped { geometries } => {
                for number in geometries.iter() {
                    self.geometries.remove(&number);
                }
            }
            Demand::Taken { bytes } => {
                self.window.take(bytes, now).map_err(|NotSent| SupplyFault::NotSent)?;
            }
            Demand::Shown { frame } => self.shown = self.shown.max(Some(frame)),
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
            self.make_ready()?;
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
            // What was dropped or lacked meanwhile stays away.
            if let Some(end) = ends.get_mut(&number) {
                *end = self.window.sent();
            }
        }
        Ok(Some(block.into()))
    }

    fn begin(&mut self) {
        self.has_begun = true;
        if let Some(view) = self.view {
            let early = std::mem::take(&mut self.early);
            self.found(&view, &early);
        }
    }

    /// Sends no more than the rest of what was begun, and knows nothing of what the display has.
    fn end(&mut self) {
        self.has_begun = false;
        self.records.clear();
        self.geometries.clear();
        self.due.clear();
        self.order.clear();
        self.ready.clear();
        self.pieces.clear();
    }

    /// Sends a drawable for a frame, unless the display has it or it is on its way.
    fn need(&mut self, frame: FrameNumber, id: DrawableId) {
        let Some(drawable) = self.scene.drawables().get(id.index()) else { return };
        if self.records.contains_key(&id.0) && self.geometries.contains_key(&drawable.geometry) {
            return;
        }
        if let Some(needed) = self.due.get_mut(&id) {
            *needed = frame.max(*needed);
            return;
        }
        let node = self.scene.nodes().get(drawable.node as usize);
        let size = node.zip(self.view).map_or(0.0, |(node, view)| {
            let (min, max) = node.world_box();
            (max - min).length_squared() / node.distance_squared(view.eye()).max(1e-6)
        });
        self.due.insert(id, frame);
        self.order.push(Due { size, id });
    }

    fn lacks(&mut self, frame: FrameNumber, taken: u64, drawables: &NumberList) {
        for id in drawables.iter().map(DrawableId) {
            let Some(drawable) = self.scene.drawables().get(id.index()) else { continue };
            // What ended later may still arrive.
            let gone = |end: Option<&u64>| end.is_some_and(|end| *end <= taken);
            if gone(self.records.get(&id.0)) && gone(self.geometries.get(&drawable.geometry)) {
                self.records.remove(&id.0);
                self.geometries.remove(&drawable.geometry);
            }
            self.need(frame, id);
        }
    }

    /// Takes the next drawables, where nothing else is ready.
    fn make_ready(&mut self) -> Result<(), SupplyFault> {
        if !self.ready.is_empty() || self.piece.is_some() {
            return Ok(());
        }
        if self.pieces.is_empty() {
            self.take_batch();
        }
        if self.ready.is_empty()
            && let Some(number) = self.pieces.pop_front()
        {
            let bytes = self.scene.packed_geometry(number).map_err(SupplyFault::Scene)?.into();
            self.piece = Some(Piece { number, bytes, sent: 0 });
        }
        Ok(())
    }

    fn take_batch(&mut self) {
        let mut entries = Vec::new();
        let mut taken = 0;
        while taken < BATCH
            && let Some(Due { id, .. }) = self.order.pop()
        {
            // What only frames that were shown needed is left.
            let needed = self.due.remove(&id).filter(|frame| Some(*frame) > self.shown);
            let Some(drawable) = self.scene.drawables().get(id.index()).filter(|_| needed.is_some()) else {
                continue;
            };
            taken += 1;
            if !self.records.contains_key(&id.0)
                && let Some(entry) = DrawableEntry::of(&self.scene, id)
            {
                self.records.insert(id.0, NOT_YET);
                entries.push(entry);
            }
            if let Entry::Vacant(place) = self.geometries.entry(drawable.geometry) {
                place.insert(NOT_YET);
                self.pieces.push_back(drawable.geometry);
            }
        }
        // In their order they pack better.
        entries.sort_unstable_by_key(|entry| entry.id);
        self.pack(&entries);
    }

    /// Packs records, in as many items as fit into a block each.
    fn pack(&mut self, entries: &[DrawableEntry]) {
        if entries.is_empty() {
            return;
        }
        let packed = Bytes::from(pack_entries(entries));
        if packed.len() + PART_HEAD > MAX_BLOCK && entries.len() > 1 {
            let (first, second) = entries.split_at(entries.len() / 2);
            self.pack(first);
            self.pack(second);
        } else {
            let ending = entries.iter().map(|entry| Ending::Record(entry.id)).collect();
            self.ready.push_back((Supply::Entries { packed }, ending));
        }
    }

    /// Puts as much of the piece into the block as it has room for. Gives false if it has none.
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

impl Ord for Due {
    fn cmp(&self, other: &Self) -> Ordering {
        self.size.total_cmp(&other.size).then(other.id.cmp(&self.id))
    }
}

impl PartialOrd for Due {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Due {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Due {}

#[cfg(test)]
#[path = "supplier_tests.rs"]
mod tests;
