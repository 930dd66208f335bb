//! The times of a pass.

use std::time::{Duration, Instant};

/// The times of a frame's pass, in milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PassTiming {
    /// The device's time for the draws: between its own timestamps around each piece of work, summed, without
    /// idle time between pieces. On a CPU driver this is wall time, including other work on the same cores.
    /// 0 if the device has no timestamps.
    pub device_ms: f64,
    /// The host's time to prepare and record the draws.
    pub host_ms: f64,
}

/// The pass that a piece of work belongs to. Copies of geometry to the device, and of depth and pictures to
/// the host, belong to none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pass {
    /// Draws into the attachments: occluders, or a picture.
    Drawing,
    /// The depth pyramid.
    Pyramid,
    /// The traversal of the tree, or tests of boxes.
    Culling,
}

/// Sums the time of some work.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Stopwatch {
    ms: f64,
}

impl Stopwatch {
    /// Runs `work` and adds the time it took.
    #[allow(
        clippy::disallowed_methods,
        reason = "the one clock of this crate's measurements; nothing waits on it"
    )]
    pub(crate) fn measure<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.ms += start.elapsed().as_secs_f64() * 1e3;
        result
    }

    /// The sum so far; starts again from 0.
    pub(crate) const fn take_ms(&mut self) -> f64 {
        std::mem::replace(&mut self.ms, 0.0)
    }
}

/// A moment that begins now.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moment {
    begun: Instant,
}

impl Moment {
    /// Longer than a thread takes to be woken up.
    const LENGTH: Duration = Duration::from_micros(100);

    #[allow(clippy::disallowed_methods, reason = "shorter than any virtual time would tell")]
    pub(crate) fn now() -> Self {
        Self { begun: Instant::now() }
    }

    pub(crate) fn is_over(self) -> bool {
        self.begun.elapsed() >= Self::LENGTH
    }
}
