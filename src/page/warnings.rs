//! Rate-limited warnings, for causes that clients control.

use std::{fmt, time::Duration};

use parking_lot::Mutex;
use trimaran_net::Instant;

/// Between two warnings.
const PAUSE: Duration = Duration::from_secs(5);

/// The time of the last one.
#[derive(Debug, Default)]
pub(super) struct Warnings(Mutex<Option<Instant>>);

impl Warnings {
    /// Logs a warning, unless there was one a moment ago.
    pub(super) fn warn(&self, warning: &impl fmt::Display, now: Instant) {
        if self.is_due(now) {
            tracing::warn!("{warning}");
        }
    }

    fn is_due(&self, now: Instant) -> bool {
        let mut last = self.0.lock();
        let is_due = last.is_none_or(|last| now.since(last) >= PAUSE);
        if is_due {
            *last = Some(now);
        }
        is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_causes_in_a_second_are_one_warning() {
        let warnings = Warnings::default();
        let due = (0..1000).filter(|tenth| warnings.is_due(Instant::from_nanos(tenth * 100_000_000)));
        assert_eq!(due.count(), 100 / 5);
    }
}
