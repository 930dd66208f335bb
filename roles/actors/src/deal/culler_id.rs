//! The number of a display's culler.

use std::fmt;

/// The number of a display's culler, counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CullerId(u8);

impl CullerId {
    /// The most cullers that a display has.
    pub const MOST: usize = 8;

    /// The first `count`, at most [`CullerId::MOST`].
    pub fn first(count: usize) -> impl ExactSizeIterator<Item = Self> + Clone {
        (0..count.min(Self::MOST) as u8).map(Self)
    }

    /// The one with this index; none beyond the last.
    #[must_use]
    pub fn of(place: usize) -> Option<Self> {
        u8::try_from(place).ok().filter(|_| place < Self::MOST).map(Self)
    }

    /// The culler's index in lists with one entry per culler.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

/// Displayed counting from 1.
impl fmt::Display for CullerId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "culler {}", self.0 + 1)
    }
}
