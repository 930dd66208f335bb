//! Objects that the sessions of one service share.

use std::{
    fmt,
    sync::{Arc, OnceLock},
};

use trimaran_proto::FrameStats;

use crate::{
    leads::Leads,
    shared_sets::SharedSets,
    supply::{Packed, PackingCounts},
};

/// Visible sets, leaders and packed geometry of a service's sessions. Clones are the same objects.
#[derive(Debug, Clone, Default)]
pub struct Sharing {
    pub(crate) sets: SharedSets,
    pub(crate) leads: Leads,
    pub(crate) packed: Packed,
    observer: Arc<OnceLock<Box<dyn SessionObserver>>>,
}

/// Observes the frames of all sessions of a service. Its time is theirs: it should count and return.
pub trait SessionObserver: fmt::Debug + Send + Sync {
    /// A session has culled and sent a frame.
    fn culled(&self, stats: &FrameStats);

    /// A session has sent a frame whose ids another one had found.
    fn shared(&self);
}

impl Sharing {
    /// Observes all sessions from now on. Only the first call counts.
    pub fn observe(&self, observer: impl SessionObserver + 'static) {
        let _observed_already = self.observer.set(Box::new(observer));
    }

    pub(crate) fn observer(&self) -> Option<&dyn SessionObserver> {
        self.observer.get().map(|observer| &**observer)
    }

    /// How often geometry was requested from the service's cache, and how often it had to be packed.
    #[must_use]
    pub fn packing(&self) -> PackingCounts {
        self.packed.counts()
    }
}
