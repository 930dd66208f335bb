//! Which culler culls which frame, and how peers can break the order.

use thiserror::Error;
use trimaran_proto::{FrameNumber, Role};

/// Which of the two cullers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CullerIndex {
    /// Culls frames 0, 2, 4, ...
    First,
    /// Culls frames 1, 3, 5, ...
    Second,
}

impl CullerIndex {
    /// Both, the first one first.
    pub const ALL: [Self; 2] = [Self::First, Self::Second];

    /// The culler of `frame`.
    #[must_use]
    pub const fn of(frame: FrameNumber) -> Self {
        if frame.0.is_multiple_of(2) { Self::First } else { Self::Second }
    }

    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::First => Self::Second,
            Self::Second => Self::First,
        }
    }

    /// Its index in lists of things that cullers have: 0 or 1.
    #[must_use]
    pub const fn index(self) -> usize {
        match self {
            Self::First => 0,
            Self::Second => 1,
        }
    }

    /// Its role on the wire.
    #[must_use]
    pub const fn role(self) -> Role {
        match self {
            Self::First => Role::FirstCuller,
            Self::Second => Role::SecondCuller,
        }
    }

    /// How messages speak of it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::First => "first culler",
            Self::Second => "second culler",
        }
    }

    /// The first frame it culls in a session that begins with `first`; `None` after the last number there is.
    pub(super) fn first_frame(self, first: FrameNumber) -> Option<FrameNumber> {
        if Self::of(first) == self { Some(first) } else { first.next() }
    }
}

/// A peer broke the order of a frame's messages. The session cannot go on: the roles would show mixed frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OrderError {
    /// A frame began that is not the one due.
    #[error("the peer began {got} where {due} was due")]
    WrongFrame {
        /// The frame that was due.
        due: FrameNumber,
        /// The frame that came.
        got: FrameNumber,
    },
    /// A camera came for a frame beyond the one that is due.
    #[error("the display sent the camera of {got} before that of {due} was used")]
    CameraAhead {
        /// The frame whose camera was due.
        due: FrameNumber,
        /// The frame whose camera came.
        got: FrameNumber,
    },
    /// The camera of a frame is not the one the display handed out for it.
    #[error("{frame} was culled from another camera than the display handed out")]
    ForeignCamera {
        /// The frame.
        frame: FrameNumber,
    },
    /// A message came while none of its kind was due.
    #[error("{what} came while {state} was due")]
    Unexpected {
        /// What came.
        what: &'static str,
        /// What was due.
        state: &'static str,
    },
}

/// The next-but-one frame, if the session has it.
pub(super) fn two_on(frame: FrameNumber, frames: Option<u32>) -> Option<FrameNumber> {
    frame.next()?.next().filter(|next| in_session(*next, frames))
}

pub(super) fn in_session(frame: FrameNumber, frames: Option<u32>) -> bool {
    frames.is_none_or(|count| frame.0 < count)
}
