//! Unreadable parts of a scene: the first fault, each page, and each thread's last fault.

use std::{
    cell::RefCell,
    collections::BTreeMap,
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
    /// This thread's last fault, and its scene.
    static HERE: RefCell<Option<(u64, ReadError)>> = const { RefCell::new(None) };
}

/// Scenes are numbered as they are made.
static MADE: AtomicU64 = AtomicU64::new(0);

#[derive(Debug)]
pub(super) struct Faults {
    scene: u64,
    first: OnceLock<ReadError>,
    /// By the section's number and the page.
    pages: RwLock<BTreeMap<(usize, usize), ReadError>>,
}

impl Faults {
    pub(super) fn none() -> Self {
        let scene = MADE.fetch_add(1, Ordering::Relaxed);
        Self { scene, first: OnceLock::new(), pages: RwLock::default() }
    }

    pub(super) fn first(&self) -> Option<&ReadError> {
        self.first.get()
    }

    /// This thread's last fault.
    pub(super) fn here(&self) -> Option<ReadError> {
        let of_this = |(scene, fault): &(u64, ReadError)| (*scene == self.scene).then(|| fault.clone());
        HERE.with_borrow(|here| here.as_ref().and_then(of_this))
    }

    /// This thread has requested something unreadable.
    pub(super) fn note(&self, fault: ReadError) {
        if self.first.get().is_none() {
            tracing::warn!(%fault, "part of the scene cannot be read");
        }
        let _later = self.first.set(fault.clone());
        HERE.set(Some((self.scene, fault)));
    }

    /// The same for a page, which is not tried again.
    pub(super) fn note_page(&self, (section, page): PageNumber, fault: ReadError) {
        self.pages.write().insert((section as usize, page), fault.clone());
        self.note(fault);
    }

    /// Whether the page is known to be unreadable; notes this thread's request.
    pub(super) fn has(&self, (section, page): PageNumber) -> bool {
        let fault = self.pages.read().get(&(section as usize, page)).cloned();
        let is_known = fault.is_some();
        fault.into_iter().for_each(|fault| self.note(fault));
        is_known
    }
}
