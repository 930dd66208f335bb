//! How long a link waits for its peer: a sender's timeout for room, and an idle timeout without any data.

use std::fmt;
use std::future::poll_fn;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use trimaran_net::{Instant, Net, Timer};

/// How often a sender looks for keep-alives in an idle timeout: as often as they are sent.
const LOOKS: u32 = 4;

/// A wait until this time has no end.
const NEVER: Instant = Instant::from_nanos(u64::MAX);

/// Bounds every wait of one half of a link.
///
/// The time counts from the beginning of a wait, not from the last byte: while the caller is busy elsewhere,
/// the peer's data waits in the system's buffers.
pub(crate) struct Timeouts {
    net: Arc<dyn Net>,
    limit: Duration,
    /// The idle timeout, unless the transport itself notices that a peer is gone.
    idle_timeout: Option<Duration>,
    /// How long nothing has come, as far as this half knows.
    quiet: Duration,
    /// When it listened last without result.
    listened: Option<Instant>,
    timer: Box<dyn Timer>,
    /// When the timer rings. It may ring early for a later wait, which then sets it again. So it is set about
    /// once per `limit`, not once per message.
    armed: Option<Instant>,
}

/// A half that listens, and has received nothing yet.
struct Listening<'t> {
    timeouts: &'t mut Timeouts,
    idle_timeout: Duration,
    since: Option<Instant>,
}

impl Listening<'_> {
    /// When it began to wait.
    fn begun(&mut self) -> Instant {
        let Timeouts { net, quiet, listened, .. } = &mut *self.timeouts;
        let idle_timeout = self.idle_timeout;
        *self.since.get_or_insert_with(|| {
            let now = net.now();
            let elsewhere = listened.map_or(Duration::ZERO, |listened| now.since(listened));
            *quiet += elsewhere.min(idle_timeout / LOOKS);
            now
        })
    }
}

/// Counts the wait, however it ends.
impl Drop for Listening<'_> {
    fn drop(&mut self) {
        if let Some(since) = self.since {
            let now = self.timeouts.net.now();
            self.timeouts.quiet += now.since(since);
            self.timeouts.listened = Some(now);
        }
    }
}

/// The known state of a peer that nobody listens to.
#[derive(Debug)]
struct Life {
    /// When something had last come.
    sign: Instant,
    /// When to look again.
    look: Instant,
}

/// A sender's wait that took too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Expired {
    /// The link's timeout ended.
    Timeout,
    /// Not even a keep-alive came.
    Idle,
}

/// A receiver's wait that ended without anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unheard {
    /// The call's deadline came.
    Deadline,
    /// Not even a keep-alive came.
    Idle,
}

impl fmt::Debug for Timeouts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Timeouts").field("limit", &self.limit).finish_non_exhaustive()
    }
}

impl Timeouts {
    /// A sender's wait lasts `limit` at most. Silence counts only if there is an idle timeout.
    pub(crate) fn new(net: &Arc<dyn Net>, limit: Duration, idle_timeout: Option<Duration>) -> Self {
        let (quiet, timer) = (Duration::ZERO, net.timer());
        Self { net: Arc::clone(net), limit, idle_timeout, quiet, listened: None, timer, armed: None }
    }

    pub(crate) const fn limit(&self) -> Duration {
        self.limit
    }

    pub(crate) const fn net(&self) -> &Arc<dyn Net> {
        &self.net
    }

    pub(crate) fn now(&self) -> Instant {
        self.net.now()
    }

    /// The output of `future`, unless the timeout ends first.
    pub(crate) async fn wait<F: Future>(&mut self, future: F) -> Result<F::Output, Expired> {
        let mut future = pin!(future);
        let mut end = None;
        poll_fn(|cx| {
            if let Poll::Ready(output) = future.as_mut().poll(cx) {
                return Poll::Ready(Ok(output));
            }
            let end = self.end(&mut end);
            self.poll_reached(end, cx).map(|()| Err(Expired::Timeout))
        })
        .await
    }

    /// The output of `future`, which hears from the peer, unless the idle timeout or the deadline `by` ends
    /// first. Dropping the future ends the wait.
    ///
    /// The idle timeout counts the time in which this half listens, over several waits if need be. While its
    /// owner is busy elsewhere, keep-alives stay unread. If none is found then, that time counts as well, but
    /// at most one keep-alive interval of it: the system may be late with it.
    pub(crate) async fn hear<F: Future>(
        &mut self,
        by: Option<Instant>,
        future: F,
    ) -> Result<F::Output, Unheard> {
        let mut future = pin!(future);
        let by = by.unwrap_or(NEVER);
        let Some(idle_timeout) = self.idle_timeout else {
            return poll_fn(|cx| match future.as_mut().poll(cx) {
                Poll::Ready(output) => Poll::Ready(Ok(output)),
                Poll::Pending => self.poll_reached(by, cx).map(|()| Err(Unheard::Deadline)),
            })
            .await;
        };
        let mut listening = Listening { timeouts: self, idle_timeout, since: None };
        poll_fn(|cx| {
            if let Poll::Ready(output) = future.as_mut().poll(cx) {
                listening.since = None;
                listening.timeouts.heard();
                return Poll::Ready(Ok(output));
            }
            let begun = listening.begun();
            let timeouts = &mut *listening.timeouts;
            let silent = begun.after(idle_timeout.saturating_sub(timeouts.quiet));
            let (at, why) = if silent < by { (silent, Unheard::Idle) } else { (by, Unheard::Deadline) };
            timeouts.poll_reached(at, cx).map(|()| Err(why))
        })
        .await
    }

    /// Something came from the peer.
    pub(crate) const fn heard(&mut self) {
        (self.quiet, self.listened) = (Duration::ZERO, None);
    }

    /// The output of `poll`, unless the timeout or the idle timeout ends first. `heard` is asked four times
    /// in each idle timeout whether anything came from the peer since the last call. Both are given `half`.
    pub(crate) async fn wait_while_alive<H: ?Sized, T>(
        &mut self,
        half: &mut H,
        mut heard: impl FnMut(&mut H) -> bool,
        mut poll: impl FnMut(&mut H, &mut Context<'_>) -> Poll<T>,
    ) -> Result<T, Expired> {
        let Some(idle_timeout) = self.idle_timeout else {
            return self.wait(poll_fn(|cx| poll(half, cx))).await;
        };
        let mut end = None;
        let mut life: Option<Life> = None;
        poll_fn(|cx| {
            if let Poll::Ready(output) = poll(half, cx) {
                return Poll::Ready(Ok(output));
            }
            let end = self.end(&mut end);
            loop {
                let now = self.net.now();
                let life = match &mut life {
                    Some(life) => life,
                    // Earlier data counts as a keep-alive at this moment, because its age is unknown.
                    None => {
                        heard(half);
                        life.insert(Life { sign: now, look: now.after(idle_timeout / LOOKS) })
                    }
                };
                if now >= life.look {
                    if heard(half) {
                        life.sign = now;
                    }
                    life.look = now.after(idle_timeout / LOOKS);
                }
                if now.since(life.sign) >= idle_timeout {
                    return Poll::Ready(Err(Expired::Idle));
                }
                if now >= end {
                    return Poll::Ready(Err(Expired::Timeout));
                }
                let at = end.min(life.look);
                ready!(self.poll_reached(at, cx));
            }
        })
        .await
    }

    /// When a sender's wait ends. It is computed only when needed, because most waits end at once.
    fn end(&self, end: &mut Option<Instant>) -> Instant {
        *end.get_or_insert_with(|| self.net.now().after(self.limit))
    }

    fn poll_reached(&mut self, at: Instant, cx: &mut Context<'_>) -> Poll<()> {
        if at == NEVER {
            return Poll::Pending;
        }
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
    use trimaran_net::sleep_until;

    const IDLE_TIMEOUT: Duration = Duration::from_secs(20);

    fn net() -> Arc<dyn Net> {
        Arc::new(TokioNet::current().unwrap())
    }

    #[tokio::test(start_paused = true)]
    async fn each_wait_has_the_whole_patience() {
        let net = net();
        let mut timeouts = Timeouts::new(&net, Duration::from_millis(100), Some(IDLE_TIMEOUT));
        for _ in 0..5 {
            let soon = net.now().after(Duration::from_millis(90));
            assert_eq!(timeouts.wait(sleep_until(&*net, soon)).await, Ok(()));
        }
        let start = net.now();
        let never = std::future::pending::<()>();
        assert_eq!(timeouts.wait(never).await, Err(Expired::Timeout));
        assert!(net.now().since(start) >= Duration::from_millis(100));
    }

    #[tokio::test(start_paused = true)]
    async fn a_deadline_cuts_a_wait_short_and_only_that_one() {
        let net = net();
        let mut timeouts = Timeouts::new(&net, Duration::from_secs(10), Some(IDLE_TIMEOUT));
        let start = net.now();
        let by = start.after(Duration::from_millis(50));
        let never = std::future::pending::<()>();
        assert_eq!(timeouts.hear(Some(by), never).await, Err(Unheard::Deadline));
        assert!(net.now().since(start) < Duration::from_secs(1));
        let later = net.now().after(Duration::from_secs(5));
        assert_eq!(timeouts.wait(sleep_until(&*net, later)).await, Ok(()));
    }

    #[tokio::test(start_paused = true)]
    async fn a_deadline_in_the_past_still_takes_what_is_there() {
        let net = net();
        let mut timeouts = Timeouts::new(&net, Duration::from_secs(10), Some(IDLE_TIMEOUT));
        let past = Instant::from_nanos(0);
        assert_eq!(timeouts.hear(Some(past), std::future::ready(7)).await, Ok(7));
        let never = std::future::pending::<()>();
        assert_eq!(timeouts.hear(Some(past), never).await, Err(Unheard::Deadline));
    }

    #[tokio::test(start_paused = true)]
    async fn keep_alives_renew_the_idle_timeout() {
        let net = net();
        let mut timeouts = Timeouts::new(&net, Duration::from_secs(1), Some(IDLE_TIMEOUT));
        for _ in 0..1000 {
            let soon = net.now().after(Duration::from_secs(19));
            assert_eq!(timeouts.hear(None, sleep_until(&*net, soon)).await, Ok(()));
        }
        let start = net.now();
        assert_eq!(timeouts.hear(None, std::future::pending::<()>()).await, Err(Unheard::Idle));
        assert_eq!(net.now().since(start).as_secs(), IDLE_TIMEOUT.as_secs());
    }

    #[tokio::test(start_paused = true)]
    async fn who_is_elsewhere_for_long_still_listens_to_the_last() {
        let net = net();
        let mut timeouts = Timeouts::new(&net, Duration::from_secs(100), Some(IDLE_TIMEOUT));
        let mut listened = 0;
        let end = loop {
            assert!(listened < 100, "the idle_timeout never ends");
            let by = net.now().after(Duration::from_secs(3));
            let never = std::future::pending::<()>();
            match timeouts.hear(Some(by), never).await {
                Err(Unheard::Deadline) => listened += 3,
                end => break end,
            }
            // Busy elsewhere for longer than the idle timeout: that counts as 5 s.
            sleep_until(&*net, net.now().after(IDLE_TIMEOUT * 2)).await;
        };
        assert_eq!((end, listened), (Err(Unheard::Idle), 9));
    }

    /// As in a loop that waits for several peers, one of which sends all the time.
    #[tokio::test(start_paused = true)]
    async fn waits_that_are_given_up_count_as_well() {
        let net = net();
        let mut timeouts = Timeouts::new(&net, Duration::from_secs(100), Some(IDLE_TIMEOUT));
        let start = net.now();
        let end = loop {
            let soon = net.now().after(Duration::from_millis(10));
            tokio::select! {
                end = timeouts.hear(None, std::future::pending::<()>()) => break end,
                () = sleep_until(&*net, soon) => {}
            }
        };
        assert_eq!((end, net.now().since(start).as_secs()), (Err(Unheard::Idle), IDLE_TIMEOUT.as_secs()));
        timeouts.heard();
        let soon = net.now().after(Duration::from_secs(19));
        assert_eq!(timeouts.hear(None, sleep_until(&*net, soon)).await, Ok(()));
    }
}
