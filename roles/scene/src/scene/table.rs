//! Arrays of records whose pages are loaded on first use.

use std::cell::Cell;
use std::ops::{Index, Range};
use std::sync::OnceLock;

use bytemuck::Pod;
use rayon::prelude::*;

use super::faults::PageNumber;
use super::given::Given;
use super::layout::Section;
use super::{ReadError, Scene, SceneError};

/// The pages of an array, each loaded on first use, and kept as long as the scene.
#[derive(Debug)]
pub(super) struct Pages<T> {
    pages: Box<[OnceLock<Box<[T]>>]>,
    length: usize,
    section: Section,
    /// The binary logarithm of a page's records.
    bits: u32,
    check: Check<T>,
    given: FindGiven<T>,
}

/// Finds a record among the given ones.
pub(super) type FindGiven<T> = fn(&Given, u32) -> Option<&T>;

/// Checks the records of a page, whose first record has the given number.
pub(super) type Check<T> = fn(&Scene, usize, &[T]) -> Result<(), SceneError>;

impl<T: Pod> Pages<T> {
    /// Without pages the records are given.
    pub(super) fn new(
        section: Section,
        length: usize,
        paged: bool,
        check: Check<T>,
        given: FindGiven<T>,
    ) -> Self {
        let pages = if paged { length.div_ceil(section.per_page()) } else { 0 };
        Self {
            pages: (0..pages).map(|_| OnceLock::new()).collect(),
            length,
            section,
            bits: section.page_bits(),
            check,
            given,
        }
    }

    /// Records in memory.
    pub(super) fn resident(&self) -> usize {
        self.pages.iter().filter_map(OnceLock::get).map(|page| page.len()).sum()
    }
}

/// An array of a scene's records, numbered from 0.
///
/// Records are read from the file a page at a time, on first use. [`read`](Self::read) tells an absent record
/// from an unreadable one. All other methods leave unreadable ones out: call them within
/// [`Scene::reading`], which returns the error.
#[derive(Debug, Clone, Copy)]
pub struct Records<'s, T> {
    scene: &'s Scene,
    pages: &'s Pages<T>,
}

impl<'s, T: Pod> Records<'s, T> {
    pub(super) const fn new(scene: &'s Scene, pages: &'s Pages<T>) -> Self {
        Self { scene, pages }
    }

    /// How many there are.
    #[must_use]
    pub const fn len(self) -> usize {
        self.pages.length
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// The record of this number; `None` past the last one.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(self, index: usize) -> Result<Option<&'s T>, ReadError> {
        match self.get(index) {
            None if index < self.len() => self.scene.reading(|| self.get(index)),
            found => Ok(found),
        }
    }

    /// The record of this number; `None` past the last one, and if it cannot be read.
    #[must_use]
    #[inline]
    pub fn get(self, index: usize) -> Option<&'s T> {
        let bits = self.pages.bits;
        let page = index >> bits;
        match self.pages.pages.get(page) {
            Some(slot) => {
                let records = slot.get().map_or_else(|| self.load(page), |records| Some(&**records))?;
                records.get(index & ((1 << bits) - 1))
            }
            None => self.given(index),
        }
    }

    /// A record of a scene without pages, if it was given.
    #[cold]
    fn given(self, index: usize) -> Option<&'s T> {
        (self.pages.given)(self.scene.given()?, u32::try_from(index).ok()?)
    }

    /// The first record.
    #[must_use]
    pub fn first(self) -> Option<&'s T> {
        self.get(0)
    }

    /// All records in order. Reads all of them, and skips unreadable ones.
    pub fn iter(self) -> impl DoubleEndedIterator<Item = &'s T> + Clone {
        self.range(0..self.len())
    }

    /// The present ones of these records.
    pub fn range(self, which: Range<usize>) -> impl DoubleEndedIterator<Item = &'s T> + Clone {
        which.filter_map(move |index| self.get(index))
    }

    /// A copy of all.
    #[must_use]
    pub fn to_vec(self) -> Vec<T> {
        self.iter().copied().collect()
    }

    /// Loads those of these records that are not loaded yet, on all threads of rayon's pool, before reading
    /// many of them. Numbers past the last record are ignored. Returns whether any was loaded.
    pub fn read_ahead(self, numbers: impl Iterator<Item = usize>) -> bool
    where
        T: Send + Sync,
    {
        let bits = self.pages.bits;
        let is_unread = |page: &usize| self.pages.pages.get(*page).is_some_and(|page| page.get().is_none());
        let mut last = usize::MAX;
        let mut unread: Vec<usize> = numbers
            .map(|number| number >> bits)
            .filter(|page| std::mem::replace(&mut last, *page) != *page && is_unread(page))
            .collect();
        if unread.len() > 1 {
            unread.sort_unstable();
            unread.dedup();
            unread.par_iter().for_each(|page| {
                self.load(*page);
            });
            // Pages that another thread could not read were requested by this one.
            unread.iter().filter(|page| is_unread(page)).for_each(|page| {
                self.load(*page);
            });
        }
        !unread.is_empty()
    }

    /// Loads the rest.
    pub(super) fn load_all(self)
    where
        T: Send + Sync,
    {
        let unread = self.pages.pages.par_iter().enumerate().filter(|(_, page)| page.get().is_none());
        unread.for_each(|(page, _)| {
            self.load(page);
        });
    }

    /// The numbers of a page's records.
    pub(super) fn numbers(self, page: usize) -> Range<usize> {
        let (first, end) = (page * self.pages.section.per_page(), (page + 1) * self.pages.section.per_page());
        first.min(self.len())..end.min(self.len())
    }

    #[cold]
    fn load(self, page: usize) -> Option<&'s [T]> {
        if CHECKING.get().is_some() {
            // The caller loads it, and then checks again.
            CHECKING.set(Some(Some((self.pages.section, page))));
            return None;
        }
        let number = (self.pages.section, page);
        if self.scene.faults.has(number) {
            return None;
        }
        if let Err(fault) = load(self.scene, number) {
            self.scene.faults.note_page(number, fault);
        }
        self.pages.pages.get(page)?.get().map(|records| &**records)
    }

    /// Reads and checks a page, and keeps it. Returns a page that must be loaded first, if any.
    fn check(self, page: usize) -> Result<Option<PageNumber>, ReadError> {
        let (section, numbers, file) = (self.pages.section, self.numbers(page), self.scene.file());
        // The layout was checked when the file was opened: as many records as the page holds.
        let mut records = vec![T::zeroed(); numbers.len()].into_boxed_slice();
        file.unpack_into(section, page, &numbers, bytemuck::cast_slice_mut(&mut records))?;
        CHECKING.set(Some(None));
        let checked = (self.pages.check)(self.scene, numbers.start, &records);
        let lacking = CHECKING.take().flatten();
        if lacking.is_none() {
            checked.map_err(|error| file.malformed(section, page, &numbers, error))?;
            // Another thread may have been first; both read the same.
            self.pages.pages.get(page).map(|slot| slot.get_or_init(|| records));
        }
        Ok(lacking)
    }
}

thread_local! {
    /// While this thread checks a page: the last missing page that the check requested.
    static CHECKING: Cell<Option<Option<PageNumber>>> = const { Cell::new(None) };
}

/// Loads a page, and before it all pages that its check requests. Iterative instead of recursive: a tree may
/// be as deep as it has pages.
fn load(scene: &Scene, page: PageNumber) -> Result<(), ReadError> {
    let mut open = vec![page];
    while let Some(&(section, page)) = open.last() {
        let lacking = match section {
            Section::Nodes => scene.nodes().check(page)?,
            Section::Drawables => scene.drawables().check(page)?,
            Section::Places => scene.places().check(page)?,
            Section::Objects => scene.objects().check(page)?,
            // These have no records.
            Section::Names
            | Section::Sources
            | Section::Hierarchy
            | Section::Coordinates
            | Section::Geometry
            | Section::Overview => None,
        };
        match lacking {
            Some(page) => open.push(page),
            None => drop(open.pop()),
        }
    }
    Ok(())
}

/// # Panics
/// Past the last record, like a slice. Code with numbers from a file uses [`Records::get`].
impl<T: Pod> Index<usize> for Records<'_, T> {
    type Output = T;

    #[allow(clippy::expect_used, reason = "an index that is not there panics, as everywhere")]
    fn index(&self, index: usize) -> &T {
        self.get(index).expect("an index within the records, all of which can be read")
    }
}

impl<T: Pod + PartialEq> PartialEq for Records<'_, T> {
    fn eq(&self, other: &Self) -> bool {
        self.len() == other.len() && self.iter().eq(other.iter())
    }
}

impl<'s, T: Pod> IntoIterator for Records<'s, T> {
    type Item = &'s T;
    type IntoIter = Box<dyn Iterator<Item = &'s T> + 's>;

    fn into_iter(self) -> Self::IntoIter {
        Box::new(self.iter())
    }
}
