//! The geometry of a display without a scene, within a budget.

use std::collections::{BTreeSet, HashMap};
use std::ops::Range;
use std::sync::Arc;

use bytes::{Bytes, BytesMut};
use parking_lot::Mutex;
use thiserror::Error;
use tokio::sync::Notify;
use trimaran_proto::{BulkError, DrawableId, NumberList, Supply, items};
use trimaran_scene::{EntriesError, GiveError, Scene, unpack_entries};

/// The most bytes of a piece of geometry: far more than cooking makes.
const LARGEST_PIECE: u32 = 64 << 20;
/// The most records: about a gigabyte of them.
const MOST_RECORDS: usize = 4 << 20;
/// How far the budget may be exceeded before there is time to evict.
const SLACK: u64 = 64 << 20;

/// Why a display rejects received data. It drops the culler.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SupplyError {
    /// The block is invalid.
    #[error(transparent)]
    Block(#[from] BulkError),
    /// Records cannot be unpacked.
    #[error(transparent)]
    Entries(#[from] EntriesError),
    /// The data does not belong to the scene.
    #[error(transparent)]
    Give(#[from] GiveError),
    /// A part of a piece of geometry is out of order.
    #[error("a part of the geometry {0} came where that was not due")]
    Part(u32),
    /// A piece of geometry is too large.
    #[error("the geometry {number} is said to have {length} bytes, and none has more than {LARGEST_PIECE}")]
    Large {
        /// Its number.
        number: u32,
        /// Its bytes.
        length: u32,
    },
    /// It sent more records than a display keeps.
    #[error("it sent more than {MOST_RECORDS} records of drawables")]
    Records,
    /// It does not receive the display's requests.
    #[error("it sends geometry, and hears nothing of what the display has and lacks")]
    Unheard,
}

impl SupplyError {
    /// Whether earlier data may be the wrong one: then nothing can be shown any more.
    #[must_use]
    pub const fn doubts_what_is_there(&self) -> bool {
        matches!(self, Self::Give(error) if error.doubts_what_is_there())
    }
}

/// Geometry sent before a frame needed it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AheadUse {
    /// Pieces.
    pub pieces: u64,
    /// Their bytes, packed.
    pub bytes: u64,
    /// The pieces that a frame has used since.
    pub used_pieces: u64,
    /// Their bytes.
    pub used_bytes: u64,
}

/// A display's geometry. Tasks add received data, and the display notes the use by frames.
#[derive(Debug)]
pub(crate) struct Holdings {
    scene: Arc<Scene>,
    budget: u64,
    inner: Mutex<Inner>,
    /// Signals new data.
    pub(crate) came: Notify,
    /// Signals that there is room again.
    pub(super) room: Notify,
}

#[derive(Debug, Default)]
struct Inner {
    records: Vec<u32>,
    /// When each piece of geometry was used last.
    pieces: HashMap<u32, u64>,
    /// Unused pieces that were sent ahead; with their bytes once they have come.
    ahead: HashMap<u32, u64>,
    ahead_use: AheadUse,
    /// Stand-ins for drawables: the drawables of a coarser level.
    stand_ins: HashMap<DrawableId, Range<u32>>,
    bytes: u64,
    /// The limit for taking more.
    limit: u64,
    tick: u64,
}

/// A piece of geometry that is partly received.
#[derive(Debug, Default)]
pub(super) struct Arriving(Option<(u32, u32, BytesMut)>);

impl Holdings {
    /// For a scene that is [empty](Scene::empty), within this many bytes of packed geometry. The geometry of
    /// one frame is held even beyond the budget.
    pub(crate) fn new(scene: &Arc<Scene>, budget: u64) -> Self {
        let inner = Inner { limit: budget + SLACK, ..Inner::default() };
        Self {
            scene: Arc::clone(scene),
            budget,
            inner: Mutex::new(inner),
            came: Notify::new(),
            room: Notify::new(),
        }
    }

    /// Takes a block of one culler.
    pub(super) fn take(&self, block: &[u8], arriving: &mut Arriving) -> Result<(), SupplyError> {
        for item in items(block)? {
            match item {
                Supply::Entries { packed } => {
                    for entry in unpack_entries(&packed)? {
                        let known = self.scene.drawables().get(entry.id as usize).is_some();
                        self.scene.give(&entry)?;
                        let records = &mut self.inner.lock().records;
                        if !known {
                            records.push(entry.id);
                        }
                        if records.len() > MOST_RECORDS {
                            return Err(SupplyError::Records);
                        }
                    }
                }
                Supply::Geometry { number, length, offset, part } => {
                    if let Some(bytes) = arriving.take(number, length, offset, part)? {
                        self.take_piece(number, bytes)?;
                    }
                }
                Supply::StandIn { id, pieces, drawables } => {
                    let level = id.0..id.0.saturating_add(pieces);
                    let stand_ins = &mut self.inner.lock().stand_ins;
                    stand_ins.extend(drawables.iter().map(|finer| (DrawableId(finer), level.clone())));
                    if stand_ins.len() > MOST_RECORDS {
                        return Err(SupplyError::Records);
                    }
                }
                Supply::Ahead { geometries } => {
                    let mut inner = self.inner.lock();
                    // Those that it already has were not sent now.
                    let new: Vec<_> =
                        geometries.iter().filter(|number| !inner.pieces.contains_key(number)).collect();
                    inner.ahead.extend(new.into_iter().map(|number| (number, 0)));
                    if inner.ahead.len() > MOST_RECORDS {
                        return Err(SupplyError::Records);
                    }
                }
                _ => {}
            }
        }
        self.came.notify_one();
        Ok(())
    }

    fn take_piece(&self, number: u32, packed: Bytes) -> Result<(), GiveError> {
        let bytes = packed.len() as u64;
        self.scene.give_geometry(number, packed)?;
        let mut inner = self.inner.lock();
        let used = inner.tick;
        if let Some(came) = inner.ahead.get_mut(&number) {
            *came = bytes;
            inner.ahead_use.pieces += 1;
            inner.ahead_use.bytes += bytes;
        }
        if inner.pieces.insert(number, used).is_none() {
            inner.bytes += bytes;
        }
        Ok(())
    }

    /// Whether more may come.
    pub(super) fn has_room(&self) -> bool {
        let inner = self.inner.lock();
        inner.bytes <= inner.limit
    }

    /// Those of these drawables that are not complete.
    pub(crate) fn lacking(&self, ids: &[DrawableId]) -> Result<Vec<DrawableId>, GiveError> {
        let mut lacking = Vec::new();
        for id in ids {
            if !self.scene.has(*id)? {
                lacking.push(*id);
            }
        }
        Ok(lacking)
    }

    /// Stand-ins for incomplete drawables, each once; none if one of them has no stand-in.
    pub(crate) fn stand_ins(&self, lacking: &[DrawableId]) -> Result<Option<Vec<DrawableId>>, GiveError> {
        let mut stand_ins = BTreeSet::new();
        let inner = self.inner.lock();
        for id in lacking {
            let level = inner.stand_ins.get(id).filter(|level| !level.is_empty());
            let Some(level) = level else { return Ok(None) };
            for stand_in in level.clone().map(DrawableId) {
                if !stand_ins.contains(&stand_in) && !self.scene.has(stand_in)? {
                    return Ok(None);
                }
                stand_ins.insert(stand_in);
            }
        }
        Ok(Some(stand_ins.into_iter().collect()))
    }

    /// All records and pieces of geometry.
    pub(crate) fn all(&self) -> [NumberList; 2] {
        let inner = self.inner.lock();
        [inner.records.clone(), inner.pieces.keys().copied().collect()].map(NumberList::of)
    }

    /// The use of geometry sent ahead.
    pub(crate) fn ahead_use(&self) -> AheadUse {
        self.inner.lock().ahead_use
    }

    /// A frame of these drawables is drawn.
    pub(crate) fn used(&self, ids: &[DrawableId]) {
        let mut inner = self.inner.lock();
        inner.tick += 1;
        inner.touch(&self.scene, ids);
    }

    /// Beyond the budget, evicts the least recently used geometry, but none of the due frame, which consists
    /// of all `these`. Returns the evicted pieces.
    pub(crate) fn trim(&self, these: &[&[DrawableId]]) -> NumberList {
        let mut inner = self.inner.lock();
        if inner.bytes <= self.budget {
            return NumberList::default();
        }
        inner.tick += 1;
        these.iter().for_each(|ids| inner.touch(&self.scene, ids));
        let now = inner.tick;
        let idle = inner.pieces.iter().filter(|(_, used)| **used < now);
        let mut by_age: Vec<_> = idle.map(|(number, used)| (*used, *number)).collect();
        by_age.sort_unstable();
        let mut dropped = Vec::new();
        for (_, number) in by_age {
            if inner.bytes <= self.budget {
                break;
            }
            inner.pieces.remove(&number);
            inner.ahead.remove(&number);
            inner.bytes -= self.scene.take_back_geometry(number) as u64;
            dropped.push(number);
        }
        inner.limit = self.budget.max(inner.bytes) + SLACK;
        drop(inner);
        self.room.notify_waiters();
        NumberList::of(dropped)
    }
}

impl Inner {
    fn touch(&mut self, scene: &Scene, ids: &[DrawableId]) {
        let now = self.tick;
        for drawable in ids.iter().filter_map(|id| scene.drawables().get(id.index())) {
            if let Some(used) = self.pieces.get_mut(&drawable.geometry) {
                *used = now;
                if let Some(bytes) = self.ahead.remove(&drawable.geometry) {
                    self.ahead_use.used_pieces += 1;
                    self.ahead_use.used_bytes += bytes;
                }
            }
        }
    }
}

impl Arriving {
    /// Adds a part; returns the piece if that was the last one.
    fn take(
        &mut self,
        number: u32,
        length: u32,
        offset: u32,
        part: Bytes,
    ) -> Result<Option<Bytes>, SupplyError> {
        if length > LARGEST_PIECE {
            return Err(SupplyError::Large { number, length });
        }
        let (known, whole, mut bytes) = self.0.take().unwrap_or((number, length, BytesMut::new()));
        let ends = bytes.len() + part.len();
        if (known, whole, bytes.len()) != (number, length, offset as usize) || ends > length as usize {
            return Err(SupplyError::Part(number));
        }
        // A piece in one part need not be copied.
        if ends == length as usize && bytes.is_empty() {
            return Ok(Some(part));
        }
        bytes.extend_from_slice(&part);
        if ends == length as usize {
            return Ok(Some(bytes.freeze()));
        }
        self.0 = Some((number, length, bytes));
        Ok(None)
    }
}

#[cfg(test)]
#[path = "holdings_tests.rs"]
mod tests;
