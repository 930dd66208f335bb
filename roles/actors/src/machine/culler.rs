//! A culler: OR for a frame, then HC for the same frame (paper, algorithm 4.2).

use trimaran_proto::{Camera, FrameNumber};

use super::order::{CullerIndex, OrderError, in_session, two_on};

/// What the culler waits for or does next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CullerStep {
    /// Wait for the display's camera of this frame, then call [`CullerMachine::camera`].
    AwaitCamera {
        /// The frame.
        frame: FrameNumber,
    },
    /// The camera is set: clear the depth and draw what the other culler sends of the frame before, from
    /// this camera. Report each message with [`CullerMachine::occluders_began`] and
    /// [`CullerMachine::occluders_ended`].
    Occlude {
        /// The frame whose occluders are drawn.
        camera: Camera,
    },
    /// The depth is complete: cull this frame with it, then call [`CullerMachine::culled`].
    Cull {
        /// The frame's camera; its number is the frame.
        camera: Camera,
        /// Whether the other culler needs the ids: not after the session's last frame.
        feeds_other: bool,
    },
    /// All frames are done.
    Done,
}

#[derive(Debug, Clone, Copy)]
enum State {
    AwaitCamera { frame: FrameNumber },
    Occlude { camera: Camera, began: bool },
    Cull { camera: Camera },
    Done,
}

/// The order in which a culler works.
#[derive(Debug, Clone)]
pub struct CullerMachine {
    first: FrameNumber,
    frames: Option<u32>,
    state: State,
}

impl CullerMachine {
    /// The culler of this index, for a session that begins with the frame `first` and ends before the frame
    /// `frames`, or never.
    #[must_use]
    pub fn new(index: CullerIndex, first: FrameNumber, frames: Option<u32>) -> Self {
        let due = index.first_frame(first).filter(|frame| in_session(*frame, frames));
        let state = due.map_or(State::Done, |frame| State::AwaitCamera { frame });
        Self { first, frames, state }
    }

    /// What is due.
    #[must_use]
    pub fn step(&self) -> CullerStep {
        match self.state {
            State::AwaitCamera { frame } => CullerStep::AwaitCamera { frame },
            State::Occlude { camera, .. } => CullerStep::Occlude { camera },
            State::Cull { camera } => CullerStep::Cull { camera, feeds_other: self.feeds_other(camera) },
            State::Done => CullerStep::Done,
        }
    }

    /// The display's newest camera arrived. One for an earlier frame is old news and ignored.
    ///
    /// # Errors
    /// If it is for a later frame than the one due, or no camera was due.
    pub fn camera(&mut self, camera: Camera) -> Result<(), OrderError> {
        let State::AwaitCamera { frame } = self.state else {
            return Err(self.unexpected("a camera"));
        };
        match camera.frame().cmp(&frame) {
            std::cmp::Ordering::Less => {}
            // The first frame has none before it whose visible set could hide something.
            std::cmp::Ordering::Equal if frame == self.first => self.state = State::Cull { camera },
            std::cmp::Ordering::Equal => self.state = State::Occlude { camera, began: false },
            std::cmp::Ordering::Greater => {
                return Err(OrderError::CameraAhead { due: frame, got: camera.frame() });
            }
        }
        Ok(())
    }

    /// The other culler began to send the ids of a frame.
    ///
    /// # Errors
    /// If it is not the frame before the one whose occluders are due, or has begun already.
    pub fn occluders_began(&mut self, frame: FrameNumber) -> Result<(), OrderError> {
        match &mut self.state {
            State::Occlude { camera, began } if !*began => {
                let due = FrameNumber(camera.frame().0 - 1);
                if frame != due {
                    return Err(OrderError::WrongFrame { due, got: frame });
                }
                *began = true;
                Ok(())
            }
            _ => Err(self.unexpected("the begin of a frame")),
        }
    }

    /// The other culler sent the end of its frame. Whether all its ids arrived does not matter here: any
    /// subset of them is a valid set of occluders, and fewer only loosen the culling.
    ///
    /// # Errors
    /// If no frame had begun.
    pub fn occluders_ended(&mut self) -> Result<(), OrderError> {
        match self.state {
            State::Occlude { camera, began: true } => {
                self.state = State::Cull { camera };
                Ok(())
            }
            _ => Err(self.unexpected("the end of a frame")),
        }
    }

    /// The frame has been culled and its end sent: the cullers swap.
    ///
    /// # Errors
    /// If no culling was due.
    pub fn culled(&mut self) -> Result<(), OrderError> {
        let State::Cull { camera } = self.state else {
            return Err(self.unexpected("the end of culling"));
        };
        self.state = match two_on(camera.frame(), self.frames) {
            Some(frame) => State::AwaitCamera { frame },
            None => State::Done,
        };
        Ok(())
    }

    fn feeds_other(&self, camera: Camera) -> bool {
        camera.frame().next().is_some_and(|next| in_session(next, self.frames))
    }

    const fn unexpected(&self, what: &'static str) -> OrderError {
        let state = match self.state {
            State::AwaitCamera { .. } => "a camera",
            State::Occlude { began: false, .. } => "the begin of the occluders' frame",
            State::Occlude { began: true, .. } => "the occluders' ids or their end",
            State::Cull { .. } => "the culling of a frame",
            State::Done => "nothing more",
        };
        OrderError::Unexpected { what, state }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(frame: u32) -> Camera {
        Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.0, 0.1, FrameNumber(frame)).unwrap()
    }

    #[test]
    fn an_old_camera_is_ignored_and_one_ahead_refused() {
        let mut machine = CullerMachine::new(CullerIndex::Second, FrameNumber(0), None);
        machine.camera(camera(0)).unwrap();
        assert_eq!(machine.step(), CullerStep::AwaitCamera { frame: FrameNumber(1) });
        assert_eq!(
            machine.camera(camera(3)),
            Err(OrderError::CameraAhead { due: FrameNumber(1), got: FrameNumber(3) })
        );
    }

    #[test]
    fn messages_out_of_order_are_refused_and_change_nothing() {
        let mut machine = CullerMachine::new(CullerIndex::Second, FrameNumber(0), None);
        assert!(matches!(machine.occluders_ended(), Err(OrderError::Unexpected { .. })));
        assert!(matches!(machine.culled(), Err(OrderError::Unexpected { .. })));
        machine.camera(camera(1)).unwrap();
        assert!(matches!(machine.occluders_ended(), Err(OrderError::Unexpected { .. })));
        assert_eq!(
            machine.occluders_began(FrameNumber(2)),
            Err(OrderError::WrongFrame { due: FrameNumber(0), got: FrameNumber(2) })
        );
        machine.occluders_began(FrameNumber(0)).unwrap();
        assert!(matches!(machine.occluders_began(FrameNumber(0)), Err(OrderError::Unexpected { .. })));
        assert_eq!(machine.step(), CullerStep::Occlude { camera: camera(1) });
    }
}
