//! Objects that the sessions of one service share.

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
}

impl Sharing {
    /// How often geometry was requested from the service's cache, and how often it had to be packed.
    #[must_use]
    pub fn packing(&self) -> PackingCounts {
        self.packed.counts()
    }
}
