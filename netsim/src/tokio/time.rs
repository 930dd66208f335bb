//! Sleeping, timeouts and intervals in virtual time.

use std::fmt;
use std::future::poll_fn;
use std::io;
use std::ops::{Add, AddAssign, Sub, SubAssign};
use std::pin::Pin;
use std::task::{Context, Poll};

use thiserror::Error;
use trimaran_net::{Instant as NetInstant, Net, Timer};

use crate::net::context::current;

pub use std::time::Duration;

/// A point in virtual time. Outside of a simulation time stands still at its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instant(NetInstant);

impl Instant {
    /// The time of the simulation.
    #[must_use]
    pub fn now() -> Self {
        Self(current().map_or(NetInstant::from_nanos(0), |net| net.now()))
    }

    /// How long ago it was; zero if it lies ahead.
    #[must_use]
    pub fn elapsed(&self) -> Duration {
        Self::now().duration_since(*self)
    }

    /// How long `earlier` was before it; zero if it was after.
    #[must_use]
    pub const fn duration_since(&self, earlier: Self) -> Duration {
        self.0.since(earlier.0)
    }

    /// How long `earlier` was before it; `None` if it was after.
    #[must_use]
    pub fn checked_duration_since(&self, earlier: Self) -> Option<Duration> {
        (earlier <= *self).then(|| self.duration_since(earlier))
    }
}

impl Add<Duration> for Instant {
    type Output = Self;

    /// So much later, or the last possible time.
    fn add(self, duration: Duration) -> Self {
        Self(self.0.after(duration))
    }
}

impl AddAssign<Duration> for Instant {
    fn add_assign(&mut self, duration: Duration) {
        *self = *self + duration;
    }
}

impl Sub<Duration> for Instant {
    type Output = Self;

    /// So much earlier, or the start of the simulation.
    fn sub(self, duration: Duration) -> Self {
        let start = NetInstant::from_nanos(0);
        Self(start.after(self.0.since(start).saturating_sub(duration)))
    }
}

impl SubAssign<Duration> for Instant {
    fn sub_assign(&mut self, duration: Duration) {
        *self = *self - duration;
    }
}

impl Sub for Instant {
    type Output = Duration;

    fn sub(self, earlier: Self) -> Duration {
        self.duration_since(earlier)
    }
}

/// Waits so long. Outside of a simulation it ends at once. Dropping it ends the wait.
pub fn sleep(duration: Duration) -> Sleep {
    sleep_until(Instant::now() + duration)
}

/// Waits until `deadline`. Outside of a simulation it ends at once. Dropping it ends the wait.
pub fn sleep_until(deadline: Instant) -> Sleep {
    let timer = current().map(|net| {
        let mut timer = net.timer();
        timer.reset(deadline.0);
        timer
    });
    Sleep { timer, deadline }
}

/// The future of [`sleep`].
#[must_use = "futures do nothing unless they are polled"]
pub struct Sleep {
    timer: Option<Box<dyn Timer>>,
    deadline: Instant,
}

impl fmt::Debug for Sleep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sleep").field("deadline", &self.deadline).finish_non_exhaustive()
    }
}

impl Sleep {
    /// When it ends.
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        self.deadline
    }

    /// Whether its time has come.
    #[must_use]
    pub fn is_elapsed(&self) -> bool {
        self.deadline <= Instant::now()
    }

    /// Lets it end at another time.
    pub fn reset(mut self: Pin<&mut Self>, deadline: Instant) {
        self.deadline = deadline;
        if let Some(timer) = &mut self.timer {
            timer.reset(deadline.0);
        }
    }
}

impl Future for Sleep {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        self.timer.as_mut().map_or(Poll::Ready(()), |timer| timer.poll(cx))
    }
}

/// Errors of this module, where tokio has them.
pub mod error {
    pub use super::Elapsed;
}

/// The time came before the future was done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the time is over")]
pub struct Elapsed(());

impl From<Elapsed> for io::Error {
    fn from(elapsed: Elapsed) -> Self {
        Self::new(io::ErrorKind::TimedOut, elapsed)
    }
}

/// The output of `future`, if it is done within so long.
///
/// Dropping the result drops `future`.
pub fn timeout<F: IntoFuture>(duration: Duration, future: F) -> Timeout<F::IntoFuture> {
    timeout_at(Instant::now() + duration, future)
}

/// The output of `future`, if it is done by `deadline`.
///
/// Dropping the result drops `future`.
pub fn timeout_at<F: IntoFuture>(deadline: Instant, future: F) -> Timeout<F::IntoFuture> {
    Timeout { future: Box::pin(future.into_future()), sleep: sleep_until(deadline) }
}

/// The future of [`timeout`].
#[derive(Debug)]
#[must_use = "futures do nothing unless they are polled"]
pub struct Timeout<F> {
    future: Pin<Box<F>>,
    sleep: Sleep,
}

impl<F: Future> Future for Timeout<F> {
    type Output = Result<F::Output, Elapsed>;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        match self.future.as_mut().poll(cx) {
            Poll::Ready(output) => Poll::Ready(Ok(output)),
            Poll::Pending => Pin::new(&mut self.sleep).poll(cx).map(|()| Err(Elapsed(()))),
        }
    }
}

/// Ticks now and then after each `period`; a period of zero counts as a nanosecond.
pub fn interval(period: Duration) -> Interval {
    interval_at(Instant::now(), period)
}

/// Ticks at `start` and then after each `period`; a period of zero counts as a nanosecond.
pub fn interval_at(start: Instant, period: Duration) -> Interval {
    Interval { next: sleep_until(start), period: period.max(Duration::from_nanos(1)) }
}

/// Ticks at regular times. Ticks that nobody waited for come at once, one after the other.
#[derive(Debug)]
pub struct Interval {
    next: Sleep,
    period: Duration,
}

impl Interval {
    /// Waits for the next tick, and returns the time for which it was set. Dropping the future loses none.
    pub async fn tick(&mut self) -> Instant {
        poll_fn(|cx| Pin::new(&mut self.next).poll(cx)).await;
        let at = self.next.deadline;
        Pin::new(&mut self.next).reset(at + self.period);
        at
    }

    /// The time from one tick to the next.
    #[must_use]
    pub const fn period(&self) -> Duration {
        self.period
    }
}
