//! The bytes of a unit, in any order: in pages, so that a byte far ahead costs one page and not the whole gap
//! before it.

use std::collections::VecDeque;
use std::ops::Range;

/// Bytes of a page.
pub(super) const PAGE: usize = 2048;
/// The bits of a page's bytes, in words.
const WORDS: usize = PAGE / 64;
/// How many free pages are kept for later units: 256 KiB.
const FREE: usize = 128;
/// How many empty page lists are kept: few frames are open at once.
const LISTS: usize = 4;

/// A few thousand bytes, and a bit for each received one.
#[derive(Debug)]
struct Page {
    bytes: [u8; PAGE],
    came: [u64; WORDS],
}

impl Page {
    const fn new() -> Self {
        Self { bytes: [0; PAGE], came: [0; WORDS] }
    }
}

type Pages = VecDeque<Option<Box<Page>>>;

/// Pages of finished units, for later ones, so that in steady state nothing is allocated.
#[derive(Debug, Default)]
pub(super) struct Pool {
    #[expect(clippy::vec_box, reason = "pages go from list to list without being copied")]
    pages: Vec<Box<Page>>,
    lists: Vec<Pages>,
    /// The cost of received bytes, in steps of eight bytes or one look-up each.
    pub(super) work: u64,
}

impl Pool {
    pub(super) fn store(&mut self) -> Store {
        Store { pages: self.lists.pop().unwrap_or_default(), ..Store::default() }
    }

    fn page(&mut self) -> Box<Page> {
        self.work += (size_of::<Page>() / 8) as u64;
        self.pages.pop().map_or_else(
            || Box::new(Page::new()),
            |mut page| {
                page.came = [0; WORDS];
                page
            },
        )
    }

    fn put(&mut self, page: Option<Box<Page>>) {
        self.work += 1;
        self.pages.extend(page.filter(|_| self.pages.len() < FREE));
    }

    /// Takes back a unit's pages.
    pub(super) fn take_back(&mut self, store: Store) {
        let Store { mut pages, .. } = store;
        while let Some(page) = pages.pop_front() {
            self.put(page);
        }
        if self.lists.len() < LISTS {
            self.lists.push(pages);
        }
    }
}

/// The received bytes of a unit, without those that are no longer needed.
#[derive(Debug, Default)]
pub(super) struct Store {
    pages: Pages,
    /// The number of the first page.
    first: u64,
    ready: u64,
}

impl Store {
    /// The end of the bytes that are complete from the beginning on, received or passed over.
    pub(super) const fn ready(&self) -> u64 {
        self.ready
    }

    /// Stores received bytes; none of them lies before the released ones.
    pub(super) fn write(&mut self, offset: u64, data: &[u8], pool: &mut Pool) {
        let mut rest = data;
        for (number, within) in pieces(offset..offset.saturating_add(data.len() as u64)) {
            let (piece, behind) = rest.split_at_checked(within.len()).unwrap_or((rest, &[]));
            rest = behind;
            let Some(page) = self.page_mut(number, pool) else { continue };
            pool.work += 4 + piece.len() as u64 / 8;
            if let Some(place) = page.bytes.get_mut(within.clone()) {
                place.copy_from_slice(piece);
            }
            for (word, mask) in words(within) {
                if let Some(came) = page.came.get_mut(word) {
                    *came |= mask;
                }
            }
        }
        self.settle(pool);
    }

    /// The page with that number, created if needed.
    fn page_mut(&mut self, number: u64, pool: &mut Pool) -> Option<&mut Page> {
        let at = usize::try_from(number.checked_sub(self.first)?).ok()?;
        if self.pages.len() <= at {
            pool.work += (at - self.pages.len()) as u64;
            self.pages.resize_with(at + 1, || None);
        }
        let page = self.pages.get_mut(at)?.get_or_insert_with(|| pool.page());
        Some(page)
    }

    fn page(&self, number: u64) -> Option<&Page> {
        let at = usize::try_from(number.checked_sub(self.first)?).ok()?;
        self.pages.get(at)?.as_deref()
    }

    /// Finds the end of the complete bytes.
    fn settle(&mut self, pool: &mut Pool) {
        while let Some(page) = self.page(self.ready / PAGE as u64) {
            let within = (self.ready % PAGE as u64) as usize;
            let Some(came) = page.came.get(within / 64) else { return };
            let run = (!(came >> (within % 64))).trailing_zeros();
            pool.work += 1;
            self.ready += u64::from(run);
            if run == 0 {
                return;
            }
        }
    }

    /// Whether all bytes of `range` were received and are still kept.
    pub(super) fn has(&self, range: Range<u64>) -> bool {
        if range.end <= self.ready && range.start >= self.first * PAGE as u64 {
            return true;
        }
        pieces(range).all(|(number, within)| {
            let Some(page) = self.page(number) else { return false };
            words(within).all(|(word, mask)| page.came.get(word).is_some_and(|came| came & mask == mask))
        })
    }

    /// The bytes of `range`, piece by piece; released ones are left out.
    pub(super) fn read(&self, range: Range<u64>) -> impl Iterator<Item = &[u8]> {
        pieces(range).filter_map(|(number, within)| self.page(number)?.bytes.get(within))
    }

    /// The first received bytes from `from` on, up to the next gap or `most` of them.
    pub(super) fn next_piece(&self, from: u64, most: u64, pool: &mut Pool) -> Option<Range<u64>> {
        let start = self.next(from, true, u64::MAX, pool)?;
        let end = self.next(start, false, start.saturating_add(most), pool)?;
        Some(start..end)
    }

    /// The first place from `from` on whose byte has come, or has not, depending on `came`; at most `limit`.
    /// Received data always ends somewhere.
    fn next(&self, from: u64, came: bool, limit: u64, pool: &mut Pool) -> Option<u64> {
        let mut at = from.max(self.first * PAGE as u64);
        while at < limit {
            pool.work += 1;
            let number = at / PAGE as u64;
            let Some(page) = self.page(number) else {
                let beyond = number.saturating_sub(self.first) >= self.pages.len() as u64;
                match came {
                    false => return Some(at),
                    true if beyond => return None,
                    true => at = (number + 1) * PAGE as u64,
                }
                continue;
            };
            let within = (at % PAGE as u64) as usize;
            let word = page.came.get(within / 64).copied().unwrap_or_default();
            let wanted = if came { word } else { !word } >> (within % 64);
            if wanted != 0 {
                return Some((at + u64::from(wanted.trailing_zeros())).min(limit));
            }
            at += 64 - (within % 64) as u64;
        }
        Some(limit)
    }

    /// Data before `base` was delivered, or will not come; data before `kept` is no longer needed.
    pub(super) fn release(&mut self, base: u64, kept: u64, pool: &mut Pool) {
        self.ready = self.ready.max(base);
        while (self.first + 1) * PAGE as u64 <= kept {
            let Some(page) = self.pages.pop_front() else {
                self.first = kept / PAGE as u64;
                return;
            };
            pool.put(page);
            self.first += 1;
        }
    }

    /// The number of its pages.
    #[cfg(test)]
    pub(super) fn pages(&self) -> usize {
        self.pages.iter().flatten().count()
    }
}

/// The pages of a range, and their bytes in it.
fn pieces(range: Range<u64>) -> impl Iterator<Item = (u64, Range<usize>)> {
    let size = PAGE as u64;
    let pages = if range.is_empty() { 0..0 } else { range.start / size..range.end.div_ceil(size) };
    pages.map(move |number| {
        let from = range.start.saturating_sub(number * size).min(size) as usize;
        let to = range.end.saturating_sub(number * size).min(size) as usize;
        (number, from..to)
    })
}

/// The bitmap words for these bytes of a page, and the bits in them.
fn words(within: Range<usize>) -> impl Iterator<Item = (usize, u64)> {
    (within.start / 64..within.end.div_ceil(64)).map(move |word| {
        let from = within.start.saturating_sub(word * 64).min(63);
        let to = within.end.saturating_sub(word * 64).min(64);
        (word, u64::MAX >> (64 - (to - from)) << from)
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_came_is_there_and_what_did_not_is_not(
            parts in prop::collection::vec((0u64..9000, 0usize..5000), 0..12),
            ask in prop::collection::vec((0u64..9000, 0u64..3000), 1..20), released in 0u64..6000,
        ) {
            let (mut pool, mut model) = (Pool::default(), BTreeMap::new());
            let mut store = pool.store();
            for (round, (offset, length)) in parts.iter().enumerate() {
                let data: Vec<u8> = (0..*length).map(|at| (at + 31 * round) as u8).collect();
                store.write(*offset, &data, &mut pool);
                model.extend((*offset..).zip(data));
            }
            let ready = (0..).find(|at| !model.contains_key(at)).unwrap();
            prop_assert_eq!(store.ready(), ready);
            store.release(0, released, &mut pool);
            for (start, length) in ask {
                let range = start.max(released)..start.max(released) + length;
                let there: Vec<u8> = range.clone().filter_map(|at| model.get(&at).copied()).collect();
                prop_assert_eq!(store.has(range.clone()), there.len() as u64 == length, "{:?}", range);
                if there.len() as u64 == length {
                    let read: Vec<u8> = store.read(range.clone()).flatten().copied().collect();
                    prop_assert_eq!(read, there);
                }
                let first = (range.start..20_000).find(|at| model.contains_key(at));
                let next = store.next_piece(range.start, length + 1, &mut pool);
                prop_assert_eq!(next.as_ref().map(|next| next.start), first);
                if let Some(next) = next {
                    let end = (next.start..).find(|at| !model.contains_key(at)).unwrap();
                    prop_assert_eq!(next.end, end.min(next.start + length + 1));
                }
            }
        }
    }

    #[test]
    fn a_byte_far_ahead_takes_a_page_and_pages_are_used_again() {
        let mut pool = Pool::default();
        let mut store = pool.store();
        store.write(4 << 20, &[1], &mut pool);
        assert_eq!((store.pages(), store.ready()), (1, 0));
        pool.take_back(store);
        assert_eq!((pool.pages.len(), pool.lists.len()), (1, 1));
        let mut store = pool.store();
        store.write(0, &[2; PAGE / 2], &mut pool);
        assert_eq!((pool.pages.len(), pool.lists.len(), store.ready()), (0, 0, PAGE as u64 / 2));
        assert!(!store.has(0..PAGE as u64), "what came before in that page is forgotten");
    }

    #[test]
    fn a_burst_does_not_keep_its_memory() {
        let mut pool = Pool::default();
        let mut stores: Vec<_> = (0..LISTS + 2).map(|_| pool.store()).collect();
        stores.iter_mut().for_each(|store| store.write(0, &[1; FREE / LISTS * PAGE], &mut pool));
        stores.into_iter().for_each(|store| pool.take_back(store));
        assert_eq!((pool.pages.len(), pool.lists.len()), (FREE, LISTS));
    }

    #[test]
    fn what_is_released_is_gone_by_whole_pages() {
        let page = PAGE as u64;
        let mut pool = Pool::default();
        let mut store = pool.store();
        store.write(0, &[1; 4 * PAGE], &mut pool);
        store.release(4 * page, 2 * page + 5, &mut pool);
        for (from, there) in [(0, false), (page + 2, false), (2 * page - 1, false), (2 * page, true)] {
            assert_eq!(store.has(from..from + 10), there, "{from}");
        }
        let before = pool.work;
        assert_eq!(store.next_piece(0, 64, &mut pool), Some(2 * page..2 * page + 64));
        assert_eq!(pool.work - before, 2, "one word is looked at, for its start and for its end");

        let mut store = pool.store();
        store.release(0, 2 * page + 5, &mut pool);
        store.write(2 * page + 5, &[1], &mut pool);
        assert!(store.has(2 * page + 5..2 * page + 6), "what comes behind released pages has a place");
    }
}
