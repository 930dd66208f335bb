//! How long a link waits for its peer.

use std::fmt;
use std::future::poll_fn;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use crate::net::{Instant, Net, Timer};

/// Bounds every wait of one half of a link.
///
/// The time counts from where a wait begins, not from the last byte: while the caller is busy elsewhere, what the peer sent
/// lies in the system's buffers, and nobody is to blame.
pub(crate) struct Patience {
    net: Arc<dyn Net>,
    limit: Duration,
    timer: Box<dyn Timer>,
    /// When the timer rings. It may ring early for a later wait, which then sets it again: so the timer is set about once
    /// per `limit`, not once per message.
    armed: Option<Instant>,
}

/// A wait that took too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Expired {
    /// The patience of the link ended.
    Patience,
    /// The deadline of the call came.
    Deadline,
}

impl fmt::Debug for Patience {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Patience").field("limit", &self.limit).finish_non_exhaustive()
    }
}

impl Patience {
    pub(crate) fn new(net: &Arc<dyn Net>, limit: Duration) -> Self {
        Self { net: Arc::clone(net), limit, timer: net.timer(), armed: None }
    }

    pub(crate) const fn limit(&self) -> Duration {
        self.limit
    }

    pub(crate) fn now(&self) -> Instant {
        self.net.now()
    }

    /// What `future` gives, unless the patience or the deadline `by` ends first.
    pub(crate) async fn wait<F: Future>(
        &mut self,
        by: Option<Instant>,
        future: F,
    ) -> Result<F::Output, Expired> {
        let mut future = pin!(future);
        let mut end = None;
        poll_fn(|cx| {
            if let Poll::Ready(output) = future.as_mut().poll(cx) {
                return Poll::Ready(Ok(output));
            }
            let (at, why) = *end.get_or_insert_with(|| {
                let patience = self.net.now().after(self.limit);
                match by {
                    Some(by) if by < patience => (by, Expired::Deadline),
                    _ => (patience, Expired::Patience),
                }
            });
            self.poll_reached(at, cx).map(|()| Err(why))
        })
        .await
    }

    fn poll_reached(&mut self, at: Instant, cx: &mut Context<'_>) -> Poll<()> {
        loop {
            if self.armed.is_none_or(|armed| armed > at) {
                self.timer.reset(at);
                self.armed = Some(at);
            }
            ready!(self.timer.poll(cx));
            self.armed = None;
            if self.net.now() >= at {
                return Poll::Ready(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TokioNet;
    use crate::net::sleep_until;

    fn net() -> Arc<dyn Net> {
        Arc::new(TokioNet::current().unwrap())
    }

    #[tokio::test(start_paused = true)]
    async fn each_wait_has_the_whole_patience() {
        let net = net();
        let mut patience = Patience::new(&net, Duration::from_millis(100));
        for _ in 0..5 {
            let soon = net.now().after(Duration::from_millis(90));
            assert_eq!(patience.wait(None, sleep_until(&*net, soon)).await, Ok(()));
        }
        let start = net.now();
        let never = std::future::pending::<()>();
        assert_eq!(patience.wait(None, never).await, Err(Expired::Patience));
        assert!(net.now().since(start) >= Duration::from_millis(100));
    }

    #[tokio::test(start_paused = true)]
    async fn a_deadline_cuts_a_wait_short_and_only_that_one() {
        let net = net();
        let mut patience = Patience::new(&net, Duration::from_secs(10));
        let start = net.now();
        let by = start.after(Duration::from_millis(50));
        let never = std::future::pending::<()>();
        assert_eq!(patience.wait(Some(by), never).await, Err(Expired::Deadline));
        assert!(net.now().since(start) < Duration::from_secs(1));
        let later = net.now().after(Duration::from_secs(5));
        assert_eq!(patience.wait(None, sleep_until(&*net, later)).await, Ok(()));
    }

    #[tokio::test(start_paused = true)]
    async fn a_deadline_in_the_past_still_takes_what_is_there() {
        let net = net();
        let mut patience = Patience::new(&net, Duration::from_secs(10));
        let past = Instant::from_nanos(0);
        assert_eq!(patience.wait(Some(past), std::future::ready(7)).await, Ok(7));
        let never = std::future::pending::<()>();
        assert_eq!(patience.wait(Some(past), never).await, Err(Expired::Deadline));
    }
}
