//! The working set: the most recently drawn geometry on a device, within a budget.
//!
//! A draw requests its geometry. Missing pieces are read from the scene, and replace the least recently used
//! ones. A pass's geometry since its beginning stays until the device is done with it: passes hold the set,
//! each from a tick on, and nothing used since the oldest such tick is dropped.

use std::collections::HashMap;
use std::sync::Arc;

use rayon::prelude::*;
use slab::Slab;
use trimaran_scene::{Geometry, GeometryPlace, ReadError, Scene};

use crate::arena::{Arena, Piece, UNIT};
use crate::memory::Buffer;
use crate::place::{Absent, Place};
use crate::{Gpu, GpuError};

/// Without a budget the set begins with this size, and doubles when it is full.
const FIRST_BYTES: u64 = 64 << 20;

/// The least share of a full set to drop at once: one scan of all pieces then serves many new ones.
const DROPPED_AT_ONCE: u64 = 16;

/// Pieces looked up at a time; the missing ones are read together.
const LOOKED_UP_AT_ONCE: usize = 1024;

/// Pieces per thread to read and unpack at a time; they are near each other in the file.
const READ_AT_ONCE: usize = 32;

/// How much of a scene's geometry a device may hold, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Budget {
    /// The most.
    pub(crate) most: u64,
    /// The initial size.
    pub(crate) first: u64,
}

/// Statistics of a working set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WorkingSetStats {
    /// Bytes of geometry on the device.
    pub resident_bytes: u64,
    /// Bytes of the device's memory allocated for geometry.
    pub taken_bytes: u64,
    /// Pieces loaded to the device.
    pub loaded: u64,
    /// Their bytes.
    pub loaded_bytes: u64,
    /// Pieces that were dropped for others.
    pub dropped: u64,
}

/// The geometry of a scene on a device.
pub(crate) struct WorkingSet {
    gpu: Arc<Gpu>,
    scene: Arc<Scene>,
    arena: Arena,
    budget: Budget,
    staged: bool,
    /// The loaded pieces.
    residents: Slab<Resident>,
    /// By number of the geometry: its key among the residents plus one, or 0.
    keys: Vec<u32>,
    tick: u64,
    /// By the passes' numbers.
    holds: HashMap<HoldId, HoldState>,
    next_hold: u64,
    /// Something was dropped, or found no room, though the budget allows more memory.
    is_cramped: bool,
    stats: WorkingSetStats,
}

struct Resident {
    number: u32,
    piece: Piece,
    used: u64,
}

/// A pass's hold on a set, by its number: the pass's pieces stay until it releases them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct HoldId(u64);

/// A pass's hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct HoldState {
    /// Pieces used at this tick or later are held.
    since: u64,
    /// How often draws were placed.
    batches: u64,
    /// All of these draws were submitted.
    is_submitted: bool,
}

/// A snapshot of holds.
#[derive(Debug)]
pub(crate) struct SubmittedHolds(Vec<(HoldId, HoldState)>);

impl Budget {
    /// The requested budget, or most of the device's memory; limited to the addressable range.
    pub(crate) fn new(gpu: &Gpu) -> Self {
        // Shaders that fetch vertices themselves need all of it in one storage buffer.
        let addressable = if gpu.fetches_vertices() { gpu.limits().max_storage_range } else { u64::MAX };
        let largest = gpu.info().max_allocation.min(addressable).min(i32::MAX as u64 * UNIT);
        match gpu.memory_budget() {
            Some(asked) => Self { most: asked.min(largest), first: asked.min(largest) },
            None => {
                let free = gpu.free_memory();
                let most = (free - free / 4).min(largest);
                Self { most, first: FIRST_BYTES.min(most) }
            }
        }
    }
}

impl WorkingSet {
    /// An empty set. `staged`: copy by the device even if the host sees its memory.
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        scene: &Arc<Scene>,
        budget: Budget,
        staged: bool,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            gpu: Arc::clone(gpu),
            scene: Arc::clone(scene),
            arena: Arena::new(gpu, budget.first, staged)?,
            budget,
            staged,
            residents: Slab::new(),
            keys: vec![0; scene.places().len()],
            tick: 1,
            holds: HashMap::new(),
            next_hold: 0,
            is_cramped: false,
            stats: WorkingSetStats::default(),
        })
    }

    /// For a pass that holds nothing yet.
    pub(crate) const fn hold(&mut self) -> HoldId {
        self.next_hold += 1;
        HoldId(self.next_hold)
    }

    /// Keeps pieces requested from now on, until [`release`](Self::release); earlier ones may be dropped. The
    /// device is done with the pass's earlier draws.
    pub(crate) fn renew(&mut self, hold: HoldId) -> Result<(), GpuError> {
        self.release(hold);
        if self.is_cramped && self.holds.is_empty() {
            self.grow()?;
        }
        self.tick += 1;
        self.holds.insert(hold, HoldState { since: self.tick, batches: 0, is_submitted: true });
        Ok(())
    }

    /// Holds pieces placed from here on, if the pass holds nothing; its draws are not submitted yet.
    pub(crate) fn begin_draws(&mut self, hold: HoldId) {
        if !self.holds.contains_key(&hold) {
            self.tick += 1;
        }
        let none = HoldState { since: self.tick, batches: 0, is_submitted: true };
        let state = self.holds.entry(hold).or_insert(none);
        state.batches += 1;
        state.is_submitted = false;
    }

    /// All draws of the pass that were placed so far were submitted.
    pub(crate) fn end_draws(&mut self, hold: HoldId) {
        if let Some(state) = self.holds.get_mut(&hold) {
            state.is_submitted = true;
        }
    }

    /// The holds whose draws were all submitted: once the device is done with these submissions, they can be
    /// [released](Self::release_all).
    pub(crate) fn submitted(&self) -> SubmittedHolds {
        let holds = self.holds.iter().filter(|(_, state)| state.is_submitted);
        SubmittedHolds(holds.map(|(id, state)| (*id, *state)).collect())
    }

    /// Releases these holds except those that have changed since.
    pub(crate) fn release_all(&mut self, holds: &SubmittedHolds) {
        for (id, state) in &holds.0 {
            if self.holds.get(id) == Some(state) {
                self.holds.remove(id);
            }
        }
    }

    /// The device is done with all draws of the pass.
    pub(crate) fn release(&mut self, hold: HoldId) {
        self.holds.remove(&hold);
    }

    /// The present buffer of the pieces. It is replaced when the set grows.
    pub(crate) const fn buffer(&self) -> &Arc<Buffer> {
        self.arena.buffer()
    }

    pub(crate) fn stats(&self) -> WorkingSetStats {
        WorkingSetStats { taken_bytes: self.arena.bytes(), ..self.stats }
    }

    /// Appends the places of these pieces to `places`, and loads missing ones as `absent` says. Ends early if
    /// there is no more room while passes hold the rest. Returns the loaded bytes.
    pub(crate) fn place(
        &mut self,
        numbers: &[u32],
        absent: Absent,
        places: &mut Vec<Option<Place>>,
    ) -> Result<u64, GpuError> {
        let before = self.stats.loaded_bytes;
        let most = match absent {
            Absent::Read => u64::MAX,
            Absent::ReadOrSkip { most } => most,
        };
        'all: for numbers in numbers.chunks(LOOKED_UP_AT_ONCE) {
            let mut read = self.read_missing(numbers, most - (self.stats.loaded_bytes - before).min(most))?;
            for &number in numbers {
                let piece = match (self.find(number), read.remove(&number), absent) {
                    (Some(piece), _, _) => Some(piece),
                    (None, Some(geometry), _) => self.insert(number, &geometry)?,
                    // It was dropped for an earlier piece.
                    (None, None, Absent::Read) => {
                        let geometry = self.scene.geometry(number).map_err(GpuError::Scene)?;
                        self.insert(number, &geometry)?
                    }
                    (None, None, Absent::ReadOrSkip { .. }) => None,
                };
                if piece.is_none() && absent == Absent::Read {
                    break 'all;
                }
                places.push(piece.map(|piece| Place {
                    first_index: piece.first_index(),
                    first_vertex: piece.first_vertex(),
                }));
            }
        }
        self.arena.finish()?;
        Ok(self.stats.loaded_bytes - before)
    }

    /// Whether another pass has draws that it has not submitted. Their geometry is held until it has.
    pub(crate) fn is_recorded_by_others(&self, hold: HoldId) -> bool {
        self.holds.iter().any(|(id, state)| *id != hold && !state.is_submitted)
    }

    /// Whether another pass holds geometry.
    pub(crate) fn is_held_by_others(&self, hold: HoldId) -> bool {
        self.holds.keys().any(|id| *id != hold)
    }

    /// Whether a piece fits into the budget.
    pub(crate) fn could_hold(&self, number: u32) -> bool {
        let place = self.scene.places().get(number as usize);
        place.is_some_and(|place| unpacked_bytes(place) <= self.budget.most)
    }

    /// An error for a piece without room although only its own pass holds pieces.
    pub(crate) fn too_small(&self, number: u32) -> GpuError {
        let place = self.scene.places().get(number as usize);
        GpuError::WorkingSetTooSmall { needed: place.map_or(0, unpacked_bytes), budget: self.budget.most }
    }

    /// The place of a piece, if loaded. It counts as used.
    fn find(&mut self, number: u32) -> Option<Piece> {
        let key = self.keys.get(number as usize)?.checked_sub(1)?;
        let resident = self.residents.get_mut(key as usize)?;
        resident.used = self.tick;
        Some(resident.piece)
    }

    /// Reads the missing ones of these pieces, up to this many bytes.
    fn read_missing(&self, numbers: &[u32], most: u64) -> Result<HashMap<u32, Geometry>, GpuError> {
        let mut missing: Vec<u32> =
            numbers.iter().copied().filter(|&number| self.keys.get(number as usize) == Some(&0)).collect();
        if missing.is_empty() {
            return Ok(HashMap::new());
        }
        // Pieces near each other share pages of the file.
        missing.sort_unstable();
        missing.dedup();
        let places = self.scene.places();
        let mut left = most;
        missing.retain(|&number| {
            let bytes = places.get(number as usize).map_or(0, unpacked_bytes);
            let fits = bytes <= left;
            left -= if fits { bytes } else { 0 };
            fits
        });
        let read: Result<Vec<Vec<(u32, Geometry)>>, ReadError> = missing
            .par_chunks(READ_AT_ONCE)
            .map(|numbers| {
                let mut reader = self.scene.reader();
                numbers.iter().map(|&number| Ok((number, reader.read(number)?))).collect()
            })
            .collect();
        Ok(read.map_err(GpuError::Scene)?.into_iter().flatten().collect())
    }

    /// Loads a piece to the device. `None` if there is no room for it, and nothing can be dropped.
    fn insert(&mut self, number: u32, geometry: &Geometry) -> Result<Option<Piece>, GpuError> {
        let Some(piece) = self.allocate(geometry) else { return Ok(None) };
        self.arena.write(piece, geometry)?;
        let key = self.residents.insert(Resident { number, piece, used: self.tick });
        if let Some(slot) = self.keys.get_mut(number as usize) {
            *slot = key as u32 + 1;
        }
        self.stats.loaded += 1;
        self.stats.loaded_bytes += piece.bytes();
        self.stats.resident_bytes += piece.bytes();
        Ok(Some(piece))
    }

    fn allocate(&mut self, geometry: &Geometry) -> Option<Piece> {
        if let Some(piece) = self.arena.allocate(geometry) {
            return Some(piece);
        }
        self.is_cramped = self.can_grow();
        if !self.arena.could_hold(geometry) {
            return None; // whatever is dropped for it
        }
        let oldest_hold = self.holds.values().map(|state| state.since).min().unwrap_or(u64::MAX);
        let free = self.residents.iter().filter(|(_, resident)| resident.used < oldest_hold);
        let mut by_age: Vec<(u64, usize)> = free.map(|(key, resident)| (resident.used, key)).collect();
        by_age.sort_unstable();
        let enough = self.arena.bytes() / DROPPED_AT_ONCE;
        let mut dropped = 0;
        let mut found = None;
        for (_, key) in by_age {
            dropped += self.drop_piece(key);
            found = found.or_else(|| self.arena.allocate(geometry));
            if found.is_some() && dropped >= enough {
                break;
            }
        }
        found
    }

    /// Drops the piece at this key, and returns its bytes.
    fn drop_piece(&mut self, key: usize) -> u64 {
        let Some(Resident { number, piece, .. }) = self.residents.try_remove(key) else { return 0 };
        if let Some(slot) = self.keys.get_mut(number as usize) {
            *slot = 0;
        }
        self.arena.free(piece);
        self.stats.dropped += 1;
        self.stats.resident_bytes -= piece.bytes();
        piece.bytes()
    }

    const fn can_grow(&self) -> bool {
        self.arena.bytes() + UNIT <= self.budget.most
    }

    /// Doubles the memory. Earlier pieces are read again on their next use.
    fn grow(&mut self) -> Result<(), GpuError> {
        let bytes = (self.arena.bytes() * 2).min(self.budget.most);
        tracing::debug!(bytes, "more memory for geometry");
        self.arena = Arena::new(&self.gpu, bytes, self.staged)?;
        self.is_cramped = false;
        self.stats.dropped += self.residents.len() as u64;
        self.stats.resident_bytes = 0;
        self.residents.clear();
        self.keys.fill(0);
        Ok(())
    }
}

/// The approximate size of a piece on a device.
fn unpacked_bytes(place: &GeometryPlace) -> u64 {
    u64::from(place.vertices) * UNIT + u64::from(place.triangles) * 12
}

#[cfg(test)]
mod tests {
    use std::thread;

    use glam::DVec3;
    use trimaran_cull::View;
    use trimaran_proto::DrawableId;
    use trimaran_scene::FlatObject;

    use super::*;
    use crate::common::{self, CheckedGpu, ids, triangles, view};
    use crate::{GpuScene, OccluderPass, PicturePass};

    /// This many crowds of 200 triangles, one before the other, each at another place.
    fn crowds(count: u32) -> Arc<Scene> {
        let crowd = |number: u32| -> FlatObject {
            let corner = |i: u32| {
                let turn = (i * 37 + number * 11) as f32;
                [turn.sin() * 2.0, (turn * 1.7).cos() * 2.0, -2.0 - 0.1 * number as f32]
            };
            triangles(&(0..600).map(corner).collect::<Vec<_>>())
        };
        Arc::new(common::scene(&(0..count).map(crowd).collect::<Vec<_>>()))
    }

    /// As many crowds on a device with this budget, and their picture with all the memory that they want.
    fn crowds_within(
        gpu: &CheckedGpu,
        count: usize,
        view: &View,
        budget: Budget,
    ) -> (Arc<GpuScene>, Vec<[u8; 4]>) {
        let scene = crowds(count as u32);
        let of = |budget| GpuScene::with(gpu, &scene, budget, false).unwrap();
        let all = of(Budget { most: 64 << 20, first: 64 << 20 });
        (of(budget), picture(&all, view, &ids(count)))
    }

    fn picture(drawn: &Arc<GpuScene>, view: &View, ids: &[DrawableId]) -> Vec<[u8; 4]> {
        common::pixels(&mut PicturePass::new(drawn, view.viewport()).unwrap(), view, ids)
    }

    #[test]
    fn copies_by_the_device_bring_the_same_as_the_host() {
        let Some(gpu) = CheckedGpu::open() else { return };
        let (scene, view) = (crowds(500), view(64, 64, DVec3::ZERO));
        let budget = Budget { most: 64 << 20, first: 64 << 20 };
        let [by_host, by_device] = [false, true].map(|staged| {
            let drawn = GpuScene::with(&gpu, &scene, budget, staged).unwrap();
            let pictures = [&ids(500)[..1], &ids(500)].map(|ids| picture(&drawn, &view, ids));
            // More than the staging buffer holds at once.
            assert!(drawn.working_set().loaded_bytes > 5 << 20);
            pictures
        });
        assert!(by_host[0] != by_host[1]);
        assert!(by_host == by_device);
        // Also when pieces come and go, over places that were in use.
        let budget = Budget { most: 1 << 20, first: 1 << 20 };
        let drawn = GpuScene::with(&gpu, &scene, budget, true).unwrap();
        assert!([&ids(500)[..1], &ids(500)].map(|ids| picture(&drawn, &view, ids)) == by_host);
    }

    #[test]
    fn a_hold_that_went_on_is_not_released_for_what_it_was() {
        let Some(gpu) = CheckedGpu::open() else { return };
        let budget = Budget { most: 1 << 20, first: 1 << 20 };
        let mut set = WorkingSet::new(&gpu, &crowds(3), budget, false).unwrap();
        let hold = set.hold();
        set.renew(hold).unwrap();
        set.begin_draws(hold);
        set.end_draws(hold);
        let submitted = set.submitted();
        // More draws, also submitted, after the snapshot.
        set.begin_draws(hold);
        set.end_draws(hold);
        set.release_all(&submitted);
        assert_eq!(set.submitted().0.len(), 1, "it still holds");
        let submitted = set.submitted();
        set.release_all(&submitted);
        assert_eq!(set.submitted().0.len(), 0);
    }

    #[test]
    fn nothing_is_dropped_for_what_would_not_fit_alone() {
        let Some(gpu) = CheckedGpu::open() else { return };
        let small = triangles(&[[0.0, 0.0, -2.0], [1.0, 0.0, -2.0], [0.0, 1.0, -2.0]]);
        let large = FlatObject { indices: [0, 1, 2].repeat(10_000), ..small.clone() };
        let scene = Arc::new(common::scene(&[small, large]));
        let budget = Budget { most: 100_000, first: 100_000 };
        let drawn = GpuScene::with(&gpu, &scene, budget, false).unwrap();
        let view = view(8, 8, DVec3::ZERO);
        let mut pass = OccluderPass::new(&drawn, view.viewport()).unwrap();
        for ids in [&ids(2)[..1], &ids(2)[1..], &ids(2)[..1]] {
            pass.begin(&view).unwrap();
            pass.draw(ids).unwrap();
            pass.finish().unwrap();
        }
        let set = drawn.working_set();
        assert_eq!((set.loaded, set.dropped), (1, 0), "the small one stayed");
    }

    #[test]
    fn a_set_doubles_until_its_budget_and_no_further() {
        let Some(gpu) = CheckedGpu::open() else { return };
        let view = view(64, 64, DVec3::ZERO);
        let budget = Budget { most: 700_000, first: 100_000 };
        let (drawn, expected) = crowds_within(&gpu, 100, &view, budget);
        let mut taken = vec![drawn.working_set().taken_bytes];
        for _ in 0..5 {
            assert!(picture(&drawn, &view, &ids(100)) == expected);
            taken.push(drawn.working_set().taken_bytes);
        }
        assert_eq!(taken[0], 100_000);
        assert!(taken.is_sorted(), "{taken:?}");
        assert_eq!(taken.last(), Some(&700_000), "{taken:?}");
    }

    /// Each of them takes all of the memory again and again. It waits until others have submitted their
    /// draws, and they do not wait for it.
    #[test]
    fn pictures_of_several_threads_share_a_little_memory() {
        let Some(gpu) = CheckedGpu::open() else { return };
        let view = view(32, 32, DVec3::ZERO);
        let (drawn, expected) = crowds_within(&gpu, 40, &view, Budget { most: 100_000, first: 100_000 });
        thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| (0..20).for_each(|_| assert!(picture(&drawn, &view, &ids(40)) == expected)));
            }
        });
    }
}
