//! The limits of waiting for a device, which may never answer.

use std::time::Duration;

/// How often a wait checks for progress and for cancellation.
pub(crate) const SLICE: Duration = Duration::from_millis(50);

/// How long work may still take after cancellation. Most frames are done by then, and nothing is abandoned.
const GRACE: Duration = Duration::from_millis(500);

/// Decides when a wait ends before the device's work is done. It counts slices instead of reading a clock, so
/// that suspending the machine does not look like a hung device.
pub(crate) struct Wait {
    timeout: Duration,
    /// Since the last progress.
    idle: Duration,
    /// Since the request to cancel.
    cancelled: Duration,
}

/// Why a wait ends early.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    Hung,
    Cancelled,
}

impl Wait {
    pub(crate) const fn new(timeout: Duration) -> Self {
        Self { timeout, idle: Duration::ZERO, cancelled: Duration::ZERO }
    }

    /// Another slice has passed without the work being done.
    pub(crate) fn slice(&mut self, progress: bool, cancel: bool) -> Option<End> {
        self.idle = if progress { Duration::ZERO } else { self.idle + SLICE };
        if cancel {
            self.cancelled += SLICE;
        }
        if self.idle >= self.timeout {
            Some(End::Hung)
        } else if self.cancelled >= GRACE {
            Some(End::Cancelled)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_puts_the_timeout_off_and_a_request_to_cancel_has_a_grace() {
        let slices = |timeout: Duration, progress: fn(u32) -> bool, cancel: fn(u32) -> bool| {
            let mut wait = Wait::new(timeout);
            (1..10_000).find_map(|n| Some((n, wait.slice(progress(n), cancel(n))?)))
        };
        let (never, second) = (|_| false, Duration::from_secs(1));
        assert_eq!(slices(second, never, never), Some((20, End::Hung)));
        assert_eq!(slices(second, |n| n == 15, never), Some((35, End::Hung)));
        assert_eq!(slices(second, |n| n % 19 == 0, never), None, "slow, and not hung");
        assert_eq!(slices(second, never, |n| n > 5), Some((15, End::Cancelled)));
        assert_eq!(slices(Duration::ZERO, never, never), Some((1, End::Hung)));
    }
}
