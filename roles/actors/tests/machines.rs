//! The three machines together, in random interleavings: whoever may move moves next, and the session still
//! ends with every frame shown once, in order, from the camera handed out for it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

use std::collections::VecDeque;

use proptest::prelude::*;
use trimaran_actors::{CullerIndex, CullerMachine, CullerStep, DisplayMachine, DisplayStep};
use trimaran_proto::{Camera, FrameNumber};

/// What travels on a frames lane. Ids do not change the order, so they are left out.
#[derive(Debug, Clone, Copy)]
enum Message {
    Begin(Camera),
    End,
}

struct Session {
    cullers: [CullerMachine; 2],
    display: DisplayMachine,
    /// The display's one-camera cell at each culler.
    cells: [Option<Camera>; 2],
    /// Frames lanes into each culler, and from each to the display.
    to_cullers: [VecDeque<Message>; 2],
    to_display: [VecDeque<Message>; 2],
    began: [bool; 2],
    shown: Vec<FrameNumber>,
}

fn camera(frame: FrameNumber) -> Camera {
    let x = f64::from(frame.0);
    Camera::new([x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 1.0, 0.1, frame).unwrap()
}

impl Session {
    fn new(first: u32, frames: u32) -> Self {
        let first = FrameNumber(first);
        let mut session = Self {
            cullers: [
                CullerMachine::new(CullerIndex::First, first, Some(frames)),
                CullerMachine::new(CullerIndex::Second, first, Some(frames)),
            ],
            display: DisplayMachine::new(first, Some(frames)),
            cells: [None; 2],
            to_cullers: Default::default(),
            to_display: Default::default(),
            began: [false; 2],
            shown: Vec::new(),
        };
        for frame in session.display.first_cameras() {
            session.hand_out(frame);
        }
        session
    }

    fn hand_out(&mut self, frame: FrameNumber) {
        let camera = camera(frame);
        self.display.hand_out(camera);
        let cell = &mut self.cells[CullerIndex::of(frame).index()];
        assert!(cell.is_none(), "a camera would replace one that its machine still needs");
        *cell = Some(camera);
    }

    /// Moves a culler by one event; false if it has to wait.
    fn move_culler(&mut self, index: CullerIndex) -> bool {
        let me = index.index();
        match self.cullers[me].step() {
            CullerStep::AwaitCamera { .. } => match self.cells[me].take() {
                Some(camera) => self.cullers[me].camera(camera).unwrap(),
                None => return false,
            },
            CullerStep::Occlude { .. } => match self.to_cullers[me].pop_front() {
                Some(Message::Begin(camera)) => self.cullers[me].occluders_began(camera.frame()).unwrap(),
                Some(Message::End) => self.cullers[me].occluders_ended().unwrap(),
                None => return false,
            },
            CullerStep::Cull { camera, feeds_other } => {
                let message = if self.began[me] { Message::End } else { Message::Begin(camera) };
                self.to_display[me].push_back(message);
                if feeds_other {
                    self.to_cullers[1 - me].push_back(message);
                }
                if self.began[me] {
                    self.cullers[me].culled().unwrap();
                }
                self.began[me] = !self.began[me];
            }
            CullerStep::Done => return false,
        }
        true
    }

    fn move_display(&mut self) -> bool {
        let DisplayStep::Await { from, frame } = self.display.step() else { return false };
        match self.to_display[from.index()].pop_front() {
            Some(Message::Begin(camera)) => {
                if let Some(next) = self.display.began(camera, true).unwrap() {
                    self.hand_out(next);
                }
            }
            Some(Message::End) => {
                self.display.ended().unwrap();
                self.shown.push(frame);
            }
            None => return false,
        }
        true
    }

    fn done(&self) -> bool {
        self.display.step() == DisplayStep::Done && self.cullers.iter().all(|m| m.step() == CullerStep::Done)
    }
}

proptest! {
    #[test]
    fn any_interleaving_shows_every_frame_once(first in 0_u32..6, frames in 0_u32..12, choices in prop::collection::vec(0_usize..3, 400)) {
        let mut session = Session::new(first, frames);
        let mut choices = choices.into_iter().chain((0..3).cycle());
        let mut idle = 0;
        while !session.done() {
            let moved = match choices.next() {
                Some(0) => session.move_culler(CullerIndex::First),
                Some(1) => session.move_culler(CullerIndex::Second),
                _ => session.move_display(),
            };
            idle = if moved { 0 } else { idle + 1 };
            prop_assert!(idle < 500, "the three wait for each other");
        }
        prop_assert_eq!(&session.shown, &(first..frames).map(FrameNumber).collect::<Vec<_>>());
        prop_assert!(session.cells.iter().all(Option::is_none), "a camera was handed out and never used");
        prop_assert!(session.to_cullers.iter().chain(&session.to_display).all(VecDeque::is_empty), "a message was never read");
    }
}
