//! State shared by the halves of a link.

use std::fmt;
use std::sync::Arc;

use crate::peer::PeerName;
use crate::stats::Counters;

/// State shared by the halves of a link.
#[derive(Debug, Clone)]
pub(crate) struct Shared {
    pub(crate) peer: PeerName,
    pub(crate) counters: Arc<Counters>,
    /// Dropped with the last half.
    pub(crate) _place: Option<Arc<dyn fmt::Debug + Send + Sync>>,
}
