//! Time for state machines.

use std::time::Duration;

/// A point in the time of one network: nanoseconds since an origin that the network chose.
///
/// Not a `std::time::Instant`, because a simulated network keeps a time of its own.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instant(u64);

impl Instant {
    /// `nanos` nanoseconds after the origin.
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the origin.
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// `duration` later, or the last possible instant (584 years after the origin).
    #[must_use]
    pub fn after(self, duration: Duration) -> Self {
        Self(self.0.saturating_add(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)))
    }

    /// How long ago `earlier` was; zero if it lies ahead.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_saturates_at_both_ends() {
        let t = Instant::from_nanos(5);
        assert_eq!(t.after(Duration::from_nanos(2)), Instant::from_nanos(7));
        assert_eq!(t.after(Duration::MAX), Instant::from_nanos(u64::MAX));
        assert_eq!(t.since(Instant::from_nanos(2)), Duration::from_nanos(3));
        assert_eq!(t.since(Instant::from_nanos(9)), Duration::ZERO);
    }
}
