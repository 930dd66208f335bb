//! State shared by the halves of a link.

use std::fmt;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use trimaran_wire::Format;

use crate::peer::PeerName;
use crate::stats::Counters;

/// State shared by the halves of a link.
#[derive(Debug, Clone)]
pub(crate) struct Shared {
    pub(crate) peer: PeerName,
    pub(crate) format: Format,
    pub(crate) counters: Arc<Counters>,
    /// Dropped with the last half.
    pub(crate) _place: Option<Arc<dyn fmt::Debug + Send + Sync>>,
}

/// The output of `next` if it needs no waiting, for callers that poll. It ignores the runtime's budget of a
/// task, which would show a full queue as empty to a loop that never yields.
pub(crate) fn at_once<T, E>(next: impl Future<Output = Result<T, E>>) -> Result<Option<T>, E> {
    match pin!(tokio::task::unconstrained(next)).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(came) => came.map(Some),
        Poll::Pending => Ok(None),
    }
}
