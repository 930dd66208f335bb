//! Packed geometry that the sessions of one service share: each piece is packed once for all of them.

use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

use bytes::Bytes;
use quick_cache::{Weighter, sync::Cache};
use trimaran_scene::{DrawableEntry, ReadError, Scene, pack_entries};

/// The memory of a service's cache, in bytes of its content: some thousand pieces and packs of records.
const MEMORY: u64 = 64 << 20;
/// About the bytes of one entry, for the cache's tables.
const TYPICAL: u64 = 2 << 10;

/// Packed pieces of geometry and packed records, within a memory limit. Clones are the same cache.
#[derive(Debug, Clone)]
pub(crate) struct Packed(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    cache: Cache<Content, Bytes, Bulk>,
    requests: AtomicU64,
    packed: AtomicU64,
}

/// How often packed geometry was requested, and how often it had to be packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct PackingCounts {
    /// Requests of sessions, for pieces of geometry and for packs of records.
    pub requests: u64,
    /// Those that were not in the cache: read from the scene, and packed.
    pub packed: u64,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Content {
    /// A piece of geometry.
    Piece(u32),
    /// The records of these drawables.
    Records(Box<[u32]>),
}

/// Bytes of content and key.
#[derive(Debug, Clone)]
struct Bulk;

impl Weighter<Content, Bytes> for Bulk {
    fn weight(&self, content: &Content, packed: &Bytes) -> u64 {
        let key = match content {
            Content::Piece(_) => 0,
            Content::Records(ids) => 4 * ids.len(),
        };
        (packed.len() + key + 64) as u64
    }
}

impl Default for Packed {
    fn default() -> Self {
        Self::of_at_most(MEMORY)
    }
}

impl Packed {
    fn of_at_most(memory: u64) -> Self {
        let cache = Cache::with_weighter((memory / TYPICAL) as usize, memory, Bulk);
        Self(Arc::new(Inner { cache, requests: AtomicU64::new(0), packed: AtomicU64::new(0) }))
    }

    /// A piece of geometry, as in the scene's file. Sessions that request it at the same time wait for the
    /// first one.
    ///
    /// # Errors
    /// When the scene cannot be read.
    pub(super) fn piece(&self, scene: &Scene, number: u32) -> Result<Bytes, ReadError> {
        self.get(&Content::Piece(number), || scene.packed_geometry(number).map(Bytes::from))
    }

    /// The records of these drawables, packed as one.
    pub(super) fn records(&self, entries: &[DrawableEntry]) -> Result<Bytes, ReadError> {
        let ids = entries.iter().map(|entry| entry.id).collect();
        self.get(&Content::Records(ids), || Ok(pack_entries(entries).into()))
    }

    pub(crate) fn counts(&self) -> PackingCounts {
        let Inner { requests, packed, .. } = &*self.0;
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        PackingCounts { requests: read(requests), packed: read(packed) }
    }

    fn get(
        &self,
        content: &Content,
        pack: impl FnOnce() -> Result<Bytes, ReadError>,
    ) -> Result<Bytes, ReadError> {
        let Inner { cache, requests, packed } = &*self.0;
        requests.fetch_add(1, Ordering::Relaxed);
        cache.get_or_insert_with(content, || {
            packed.fetch_add(1, Ordering::Relaxed);
            pack()
        })
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use trimaran_proto::DrawableId;

    use super::*;
    use crate::supply::testing::PLANT;

    fn get(packed: &Packed, number: u32, bytes: usize) -> Bytes {
        packed.get(&Content::Piece(number), || Ok(vec![number as u8; bytes].into())).unwrap()
    }

    #[test]
    fn each_is_packed_once_while_there_is_room() {
        let packed = Packed::of_at_most(1 << 20);
        for _ in 0..4 {
            for number in 0..100 {
                assert_eq!(get(&packed, number, 1_000), vec![number as u8; 1_000]);
            }
        }
        assert_eq!(packed.counts(), PackingCounts { requests: 400, packed: 100 });
    }

    #[test]
    fn each_piece_and_pack_of_records_is_that_of_the_scene() {
        let (scene, packed) = (&*PLANT, Packed::default());
        let ids = (0..scene.drawables().len() as u32).map(DrawableId);
        let entries: Vec<_> = ids.filter_map(|id| DrawableEntry::of(scene, id).unwrap()).collect();
        for _ in 0..2 {
            for number in 0..scene.outline().geometries {
                assert_eq!(packed.piece(scene, number).unwrap(), scene.packed_geometry(number).unwrap());
            }
            for entries in entries.chunks(16) {
                assert_eq!(packed.records(entries).unwrap(), pack_entries(entries));
            }
        }
    }

    /// Each is packed only once all sessions have requested it.
    #[test]
    fn sessions_that_request_it_at_the_same_time_wait_for_the_first() {
        const SESSIONS: u64 = 8;
        const PIECES: u32 = 100;
        let packed = Packed::of_at_most(1 << 24);
        let request = |number: u32| {
            packed.get(&Content::Piece(number), || {
                while packed.counts().requests < SESSIONS * (u64::from(number) + 1) {
                    thread::yield_now();
                }
                Ok(vec![number as u8; 1_000].into())
            })
        };
        thread::scope(|scope| {
            for _ in 0..SESSIONS {
                scope.spawn(|| (0..PIECES).for_each(|number| drop(request(number).unwrap())));
            }
        });
        let requests = SESSIONS * u64::from(PIECES);
        assert_eq!(packed.counts(), PackingCounts { requests, packed: PIECES.into() });
    }

    /// The work of packing a scene's geometry for several displays, against that for one of them.
    #[test]
    #[ignore = "a measurement: --release --nocapture"]
    #[allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]
    fn packing_for_many_costs_as_for_one() {
        const TRIES: usize = 9;
        let scene = &*PLANT;
        let ids = (0..scene.drawables().len() as u32).map(DrawableId);
        let entries: Vec<_> = ids.filter_map(|id| DrawableEntry::of(scene, id).unwrap()).collect();
        let serve = |packed: &Packed| {
            for number in 0..scene.outline().geometries {
                packed.piece(scene, number).unwrap();
            }
            for entries in entries.chunks(256) {
                packed.records(entries).unwrap();
            }
        };
        for sessions in [1, 8] {
            let time = |share: bool| {
                let mut times = [(); TRIES].map(|()| {
                    let (start, shared) = (std::time::Instant::now(), Packed::default());
                    for _ in 0..sessions {
                        serve(&if share { shared.clone() } else { Packed::default() });
                    }
                    start.elapsed()
                });
                times.sort_unstable();
                times[TRIES / 2]
            };
            println!("{sessions} sessions: shared {:?}, each its own {:?}", time(true), time(false));
        }
    }

    #[test]
    fn the_memory_is_bounded() {
        let packed = Packed::of_at_most(1 << 20);
        for number in 0..10_000 {
            assert_eq!(get(&packed, number, 1_000).len(), 1_000);
            assert!(packed.0.cache.len() * 1_000 <= 1 << 20);
        }
        assert!(packed.0.cache.len() > 100, "{}", packed.0.cache.len());
        assert_eq!(Packed::default().0.cache.capacity(), 64 << 20);
    }
}
