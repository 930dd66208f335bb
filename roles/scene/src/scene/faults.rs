//! Unreadable parts of a scene: the first fault, each page, and the last one in a thread's present work.

use std::{
    cell::RefCell,
    collections::{BTreeMap, HashMap},
    sync::{
        OnceLock,
        atomic::{AtomicU64, Ordering},
    },
};

use parking_lot::RwLock;

use super::{ReadError, layout::Section};

/// A page of a section.
pub(super) type PageNumber = (Section, usize);

thread_local! {
    /// By the number of a scene: the last fault of this thread's present work on it.
    static WORK: RefCell<BTreeMap<u64, Option<ReadError>>> = const { RefCell::new(BTreeMap::new()) };
}

/// Scenes are numbered as they are made.
static MADE: AtomicU64 = AtomicU64::new(0);

#[derive(Debug)]
pub(super) struct Faults {
    scene: u64,
    first: OnceLock<ReadError>,
    pages: RwLock<HashMap<PageNumber, ReadError>>,
}

impl Faults {
    pub(super) fn none() -> Self {
        let scene = MADE.fetch_add(1, Ordering::Relaxed);
        Self { scene, first: OnceLock::new(), pages: RwLock::default() }
    }

    pub(super) fn first(&self) -> Option<&ReadError> {
        self.first.get()
    }

    /// The result of `work`, unless this thread requests something unreadable in it. Then it returns the last
    /// such fault.
    pub(super) fn within<T>(&self, work: impl FnOnce() -> T) -> Result<T, ReadError> {
        let around = WORK.with_borrow_mut(|open| open.insert(self.scene, None));
        let done = work();
        let fault = WORK.with_borrow_mut(|open| {
            let fault = open.remove(&self.scene).flatten();
            if let Some(around) = around {
                // The work around this one has left the part out as well.
                open.insert(self.scene, fault.clone().or(around));
            }
            fault
        });
        fault.map_or(Ok(done), Err)
    }

    /// This thread has requested something unreadable.
    pub(super) fn note(&self, fault: ReadError) {
        if self.first.get().is_none() {
            tracing::warn!(%fault, "part of the scene cannot be read");
        }
        let _later = self.first.set(fault.clone());
        WORK.with_borrow_mut(|open| {
            if let Some(last) = open.get_mut(&self.scene) {
                *last = Some(fault);
            }
        });
    }

    /// The same for a page, which is not tried again.
    pub(super) fn note_page(&self, page: PageNumber, fault: ReadError) {
        self.pages.write().insert(page, fault.clone());
        self.note(fault);
    }

    /// Whether the page is known to be unreadable; notes this thread's request.
    pub(super) fn has(&self, page: PageNumber) -> bool {
        let fault = self.pages.read().get(&page).cloned();
        let is_known = fault.is_some();
        fault.into_iter().for_each(|fault| self.note(fault));
        is_known
    }
}
