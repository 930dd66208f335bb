//! The roles as state machines: no sockets, no clock, no GPU.
//!
//! Frames alternate: the pair's first machine culls the even frames, its second the odd ones. While one culls
//! frame i (HC), the other draws the occluders of frame i + 1 (OR) from the ids as they come; then they swap,
//! and the depth buffer never travels (paper, section 3.2). The display shows each frame (RVG) and hands out
//! the cameras.
//!
//! ```text
//! frame          0      1      2      3
//! first   OR HC ─┐ OR ──► HC ─┐ OR ──►
//! second     OR ◄┘ HC ─┐ OR ◄─┘ HC
//! display            RVG    RVG    RVG
//! ```
//!
//! Cameras are handed out ahead: the camera of frame i + 2 goes to the machine that has just begun to cull
//! frame i, so its one-camera cell is free. That bounds how far the pair can run ahead of the display, with
//! no message of its own for it.

mod display;
mod switch;

pub use display::{DisplayMachine, DisplayStep};
pub use switch::{SwitchMachine, SwitchStep};

use thiserror::Error;
use trimaran_proto::FrameNumber;

/// Which machine of the pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Seat {
    /// Culls frames 0, 2, 4, ...
    First,
    /// Culls frames 1, 3, 5, ...
    Second,
}

impl Seat {
    /// The machine that culls `frame`.
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

    /// Its place in pairs of things: 0 or 1.
    pub(crate) const fn index(self) -> usize {
        match self {
            Self::First => 0,
            Self::Second => 1,
        }
    }

    /// The first frame this machine culls in a session that begins with `first`; `None` after the last number
    /// there is.
    fn first_frame(self, first: FrameNumber) -> Option<FrameNumber> {
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

/// The frame after the machine's own next-but-one, if the session has it.
fn two_on(frame: FrameNumber, frames: Option<u32>) -> Option<FrameNumber> {
    frame.next()?.next().filter(|next| in_session(*next, frames))
}

fn in_session(frame: FrameNumber, frames: Option<u32>) -> bool {
    frames.is_none_or(|count| frame.0 < count)
}
