//! The limits of a service's sessions: the size of a picture, and depth memory over all sessions.

use std::sync::Arc;

use parking_lot::{Mutex, RwLock};
use thiserror::Error;
use trimaran_proto::Viewport;

/// Bytes of memory for a pixel of a session: its depth, a copy of it, and a pyramid over it (a third more).
const PIXEL: u64 = 14;

/// The limits of each session of a service, and of all together. Clones share one budget.
#[derive(Debug, Clone, Default)]
pub struct SessionLimits(Option<Arc<Limits>>);

#[derive(Debug)]
struct Limits {
    most: RwLock<Most>,
    taken: Mutex<u64>,
}

#[derive(Debug, Clone, Copy)]
struct Most {
    picture: Viewport,
    /// Bytes for the depth of all sessions.
    depth: u64,
}

/// Why a session is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LimitError {
    /// Its picture is too large.
    #[error(
        "a picture of {asked} pixels; this service takes up to {most}: make it smaller, or raise --max-picture"
    )]
    Picture {
        /// The size asked for.
        asked: Viewport,
        /// The largest width and the largest height.
        most: Viewport,
    },
    /// The sessions together would take too much memory.
    #[error(
        "a picture of {asked} pixels takes {needed} bytes for depth, and of this service's {most} are {free} free: \
         make it smaller, try later, or raise --depth-memory"
    )]
    DepthMemory {
        /// The size asked for.
        asked: Viewport,
        /// The bytes that it takes.
        needed: u64,
        /// The free bytes of the budget.
        free: u64,
        /// The budget, in bytes.
        most: u64,
    },
}

impl SessionLimits {
    /// Pictures no wider and no higher than `picture`, and this many bytes for the depth of all sessions.
    #[must_use]
    pub fn new(picture: Viewport, depth: u64) -> Self {
        Self(Some(Arc::new(Limits { most: RwLock::new(Most { picture, depth }), taken: Mutex::new(0) })))
    }

    /// The same as `other` from now on. Sessions keep what they have reserved.
    pub fn change(&self, other: &Self) {
        if let (Some(limits), Some(other)) = (&self.0, &other.0) {
            let most = *other.most.read();
            *limits.most.write() = most;
        }
    }

    /// No limits: the peers are of the same process.
    #[must_use]
    pub fn none() -> Self {
        Self(None)
    }

    /// The bytes that all sessions have reserved.
    #[must_use]
    pub fn reserved(&self) -> u64 {
        self.0.as_ref().map_or(0, |limits| *limits.taken.lock())
    }

    /// Reserves a session's memory for pictures of this size, until the lease is dropped.
    ///
    /// # Errors
    /// When the session's limit or the budget is exceeded.
    pub fn lease(&self, size: Viewport) -> Result<Lease, LimitError> {
        let mut lease = Lease { limits: self.clone(), bytes: 0 };
        lease.change(size)?;
        Ok(lease)
    }
}

/// A session's part of its service's budget, returned on drop.
#[derive(Debug)]
pub struct Lease {
    limits: SessionLimits,
    bytes: u64,
}

impl Lease {
    /// Changes the size of the session's pictures. On an error it keeps its old part.
    ///
    /// # Errors
    /// As [`SessionLimits::lease`].
    pub fn change(&mut self, size: Viewport) -> Result<(), LimitError> {
        let SessionLimits(Some(limits)) = &self.limits else { return Ok(()) };
        let Most { picture: most, depth } = *limits.most.read();
        if size.width() > most.width() || size.height() > most.height() {
            return Err(LimitError::Picture { asked: size, most });
        }
        let needed = u64::from(size.width()) * u64::from(size.height()) * PIXEL;
        let mut taken = limits.taken.lock();
        let free = depth.saturating_sub(*taken - self.bytes);
        if needed > free {
            return Err(LimitError::DepthMemory { asked: size, needed, free, most: depth });
        }
        *taken = *taken - self.bytes + needed;
        self.bytes = needed;
        Ok(())
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        if let SessionLimits(Some(limits)) = &self.limits {
            *limits.taken.lock() -= self.bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn size(width: u32, height: u32) -> Viewport {
        Viewport::new(width, height).unwrap()
    }

    #[test]
    fn a_picture_is_no_wider_and_no_higher_than_the_limit_and_the_refusal_names_it() {
        let limits = SessionLimits::new(size(4096, 2048), u64::MAX);
        assert!(limits.lease(size(4096, 2048)).is_ok() && limits.lease(size(1, 1)).is_ok());
        for asked in [size(4097, 1), size(1, 2049), size(65_536, 65_536)] {
            let error = limits.lease(asked).unwrap_err();
            assert_eq!(error, LimitError::Picture { asked, most: size(4096, 2048) });
            assert!(error.to_string().contains("up to 4096x2048"), "{error}");
        }
        let mut lease = limits.lease(size(8, 8)).unwrap();
        assert!(lease.change(size(4097, 8)).is_err());
        assert!(SessionLimits::none().lease(size(65_536, 65_536)).is_ok());
    }

    #[test]
    fn changed_limits_hold_for_new_sessions_and_those_that_go_on_keep_theirs() {
        let limits = SessionLimits::new(size(64, 64), 2 * 64 * 64 * PIXEL);
        let first = limits.lease(size(64, 64)).unwrap();
        limits.change(&SessionLimits::new(size(32, 32), 64 * 64 * PIXEL));
        assert!(matches!(limits.lease(size(64, 64)), Err(LimitError::Picture { .. })));
        assert!(matches!(limits.lease(size(32, 32)), Err(LimitError::DepthMemory { free: 0, .. })));
        limits.change(&SessionLimits::new(size(64, 64), 2 * 64 * 64 * PIXEL));
        assert!(limits.lease(size(64, 64)).is_ok());
        drop(first);
        assert_eq!(limits.reserved(), 0);
    }

    #[test]
    fn what_a_session_has_taken_is_free_once_it_ends_and_not_twice() {
        let limits = SessionLimits::new(size(64, 64), 2 * 64 * 64 * PIXEL);
        let [first, second] = [(); 2].map(|()| limits.lease(size(64, 64)).unwrap());
        let error = limits.lease(size(1, 1)).unwrap_err();
        assert!(matches!(error, LimitError::DepthMemory { needed: PIXEL, free: 0, .. }), "{error}");
        drop(first);
        let third = limits.lease(size(64, 64)).unwrap();
        assert!(limits.lease(size(1, 1)).is_err());
        drop((second, third));
        assert_eq!(limits.reserved(), 0);
    }

    proptest! {
        /// However sessions come, change and go, the used budget is the sum of the present sessions' needs.
        #[test]
        fn the_budget_is_kept(steps in prop::collection::vec((0_usize..4, 0_u32..40, 1_u32..40), 1..100)) {
            let limits = SessionLimits::new(size(32, 32), 2000 * PIXEL);
            let mut leases: [Option<(Lease, u64)>; 4] = [const { None }; 4];
            for (at, width, height) in steps {
                let pixels = u64::from(width) * u64::from(height);
                match (&mut leases[at], Viewport::new(width, height)) {
                    (slot, Err(_)) => *slot = None,
                    (Some((lease, taken)), Ok(size)) => {
                        if lease.change(size).is_ok() {
                            *taken = pixels;
                        }
                    }
                    (slot, Ok(size)) => *slot = limits.lease(size).ok().map(|lease| (lease, pixels)),
                }
                let sum: u64 = leases.iter().flatten().map(|(_, pixels)| pixels * PIXEL).sum();
                let taken = limits.reserved();
                prop_assert!(taken == sum && taken <= 2000 * PIXEL, "{} {}", taken, sum);
            }
        }
    }
}
