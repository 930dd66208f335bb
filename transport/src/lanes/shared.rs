//! What the halves of a link have in common.

use std::fmt;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use trimaran_wire::Format;

use crate::peer::PeerName;
use crate::stats::Counters;

/// What the halves of a link have in common.
#[derive(Debug, Clone)]
pub(crate) struct Shared {
    pub(crate) peer: PeerName,
    pub(crate) format: Format,
    pub(crate) counters: Arc<Counters>,
    /// Dropped with the last half.
    pub(crate) _place: Option<Arc<dyn fmt::Debug + Send + Sync>>,
}

/// What `next` gives without waiting, for whoever polls: not bound by the runtime's budget of a task, which
/// would show a full queue as an empty one to a loop that never yields.
pub(crate) fn at_once<T, E>(next: impl Future<Output = Result<T, E>>) -> Result<Option<T>, E> {
    match pin!(tokio::task::unconstrained(next)).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(came) => came.map(Some),
        Poll::Pending => Ok(None),
    }
}
