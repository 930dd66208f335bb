//! The display: shows each frame from the culler that culled it, and hands out cameras (paper, algorithm
//! 4.3).

use trimaran_proto::{Camera, FrameNumber};

use super::order::{CullerIndex, OrderError, in_session, two_on};

/// What the display does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DisplayStep {
    /// Read the next message of this frame from that culler: report with [`DisplayMachine::began`],
    /// [`DisplayMachine::ended`].
    Await {
        /// The culler of the frame.
        from: CullerIndex,
        /// The frame.
        frame: FrameNumber,
    },
    /// All frames have been shown.
    Done,
}

/// The order in which the display works.
#[derive(Debug, Clone)]
pub struct DisplayMachine {
    first: FrameNumber,
    frames: Option<u32>,
    due: Option<FrameNumber>,
    began: bool,
    /// The newest camera handed out for the frame that is due and for the one after it.
    handed: [Option<Camera>; 2],
}

impl DisplayMachine {
    /// A display for a session that begins with the frame `first` and ends before the frame `frames`, or
    /// never.
    #[must_use]
    pub fn new(first: FrameNumber, frames: Option<u32>) -> Self {
        let due = in_session(first, frames).then_some(first);
        Self { first, frames, due, began: false, handed: [None; 2] }
    }

    /// The frames whose cameras are handed out before anything else, each to its culler: see
    /// [`DisplayMachine::hand_out`].
    pub fn first_cameras(&self) -> impl Iterator<Item = FrameNumber> + use<> {
        let frames = self.frames;
        [Some(self.first), self.first.next()]
            .into_iter()
            .flatten()
            .filter(move |frame| in_session(*frame, frames))
    }

    /// Notes that `camera` goes to the culler of its frame. A camera handed out again for the same
    /// frame (the user has moved on) replaces the earlier one.
    pub fn hand_out(&mut self, camera: Camera) {
        self.handed[CullerIndex::of(camera.frame()).index()] = Some(camera);
    }

    /// What is due.
    #[must_use]
    pub fn step(&self) -> DisplayStep {
        match self.due {
            Some(frame) => DisplayStep::Await { from: CullerIndex::of(frame), frame },
            None => DisplayStep::Done,
        }
    }

    /// A culler began to send a frame, culled from `camera`. Says which frame's camera that culler is to get
    /// now.
    ///
    /// # Errors
    /// If the frame is not the one due, has begun already, or was culled from a camera that was not handed
    /// out for it. With `lockstep` the camera must be the newest one handed out; else the pose may be an
    /// earlier one.
    pub fn began(&mut self, camera: Camera, lockstep: bool) -> Result<Option<FrameNumber>, OrderError> {
        let due = self.due.ok_or(OrderError::Unexpected { what: "a frame", state: "nothing more" })?;
        if self.began {
            return Err(OrderError::Unexpected { what: "the begin of a frame", state: "its ids or its end" });
        }
        if camera.frame() != due {
            return Err(OrderError::WrongFrame { due, got: camera.frame() });
        }
        if lockstep && self.handed[CullerIndex::of(due).index()] != Some(camera) {
            return Err(OrderError::ForeignCamera { frame: due });
        }
        self.began = true;
        Ok(two_on(due, self.frames))
    }

    /// The frame's end arrived: it can be shown.
    ///
    /// # Errors
    /// If no frame had begun.
    pub fn ended(&mut self) -> Result<(), OrderError> {
        match self.due {
            Some(frame) if self.began => {
                self.began = false;
                self.due = frame.next().filter(|next| in_session(*next, self.frames));
                Ok(())
            }
            _ => Err(OrderError::Unexpected { what: "the end of a frame", state: "the begin of a frame" }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(frame: u32) -> Camera {
        Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.0, 0.1, FrameNumber(frame)).unwrap()
    }

    #[test]
    fn a_frame_out_of_turn_is_refused() {
        let mut display = DisplayMachine::new(FrameNumber(0), None);
        assert_eq!(
            display.began(camera(1), true),
            Err(OrderError::WrongFrame { due: FrameNumber(0), got: FrameNumber(1) })
        );
        assert!(matches!(display.ended(), Err(OrderError::Unexpected { .. })));
        let mut done = DisplayMachine::new(FrameNumber(3), Some(3));
        assert!(matches!(done.began(camera(3), true), Err(OrderError::Unexpected { .. })));
    }

    #[test]
    fn in_lockstep_a_foreign_camera_is_refused() {
        let mut display = DisplayMachine::new(FrameNumber(0), None);
        let moved =
            Camera::new([1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 1.0, 0.1, FrameNumber(0)).unwrap();
        display.hand_out(camera(0));
        assert_eq!(display.began(moved, true), Err(OrderError::ForeignCamera { frame: FrameNumber(0) }));
        assert_eq!(display.began(moved, false), Ok(Some(FrameNumber(2))));
    }
}
