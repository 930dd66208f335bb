//! The three machines together, in random interleavings: whoever may move moves next, and the session still
//! ends with every frame shown once, in order, from the camera handed out for it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

use std::collections::VecDeque;

use proptest::prelude::*;
use trimaran_actors::{DisplayMachine, DisplayStep, Seat, SwitchMachine, SwitchStep};
use trimaran_proto::{Camera, FrameNumber};

/// What travels on a frames lane. Ids do not change the order, so they are left out.
#[derive(Debug, Clone, Copy)]
enum Message {
    Begin(Camera),
    End,
}

struct Session {
    pair: [SwitchMachine; 2],
    display: DisplayMachine,
    /// The display's one-camera cell at each machine of the pair.
    cells: [Option<Camera>; 2],
    /// Frames lanes into each machine of the pair, and from each to the display.
    to_pair: [VecDeque<Message>; 2],
    to_display: [VecDeque<Message>; 2],
    began: [bool; 2],
    shown: Vec<FrameNumber>,
}

fn camera(frame: FrameNumber) -> Camera {
    let x = f64::from(frame.0);
    Camera::new([x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 1.0, 0.1, frame).unwrap()
}

const fn index(seat: Seat) -> usize {
    match seat {
        Seat::First => 0,
        Seat::Second => 1,
    }
}

impl Session {
    fn new(first: u32, frames: u32) -> Self {
        let first = FrameNumber(first);
        let mut session = Self {
            pair: [
                SwitchMachine::new(Seat::First, first, Some(frames)),
                SwitchMachine::new(Seat::Second, first, Some(frames)),
            ],
            display: DisplayMachine::new(first, Some(frames)),
            cells: [None; 2],
            to_pair: Default::default(),
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
        let cell = &mut self.cells[index(Seat::of(frame))];
        assert!(cell.is_none(), "a camera would replace one that its machine still needs");
        *cell = Some(camera);
    }

    /// Moves a machine of the pair by one event; false if it has to wait.
    fn move_pair(&mut self, seat: Seat) -> bool {
        let me = index(seat);
        match self.pair[me].step() {
            SwitchStep::AwaitCamera { .. } => match self.cells[me].take() {
                Some(camera) => self.pair[me].camera(camera).unwrap(),
                None => return false,
            },
            SwitchStep::Occlude { .. } => match self.to_pair[me].pop_front() {
                Some(Message::Begin(camera)) => self.pair[me].occluders_began(camera.frame()).unwrap(),
                Some(Message::End) => self.pair[me].occluders_ended().unwrap(),
                None => return false,
            },
            SwitchStep::Cull { camera, feeds_other } => {
                let message = if self.began[me] { Message::End } else { Message::Begin(camera) };
                self.to_display[me].push_back(message);
                if feeds_other {
                    self.to_pair[1 - me].push_back(message);
                }
                if self.began[me] {
                    self.pair[me].culled().unwrap();
                }
                self.began[me] = !self.began[me];
            }
            SwitchStep::Done => return false,
        }
        true
    }

    fn move_display(&mut self) -> bool {
        let DisplayStep::Await { from, frame } = self.display.step() else { return false };
        match self.to_display[index(from)].pop_front() {
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
        self.display.step() == DisplayStep::Done && self.pair.iter().all(|m| m.step() == SwitchStep::Done)
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
                Some(0) => session.move_pair(Seat::First),
                Some(1) => session.move_pair(Seat::Second),
                _ => session.move_display(),
            };
            idle = if moved { 0 } else { idle + 1 };
            prop_assert!(idle < 500, "the three wait for each other");
        }
        prop_assert_eq!(&session.shown, &(first..frames).map(FrameNumber).collect::<Vec<_>>());
        prop_assert!(session.cells.iter().all(Option::is_none), "a camera was handed out and never used");
        prop_assert!(session.to_pair.iter().chain(&session.to_display).all(VecDeque::is_empty), "a message was never read");
    }
}
