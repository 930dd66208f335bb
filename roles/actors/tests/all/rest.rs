//! A live display with an eye at rest.

use trimaran_actors::{Cameras, LocalSession, Pace};
use trimaran_proto::{Camera, FrameNumber};

use crate::common::{Device, Frames, middle, play, settings, small_scene, turned};

/// How often each pose is requested. The display asks every few milliseconds.
const ASKED: u32 = 200;

/// An eye that rests at several places in turn.
struct Resting {
    middle: [f64; 3],
    asked: u32,
    places: u32,
}

impl Cameras for Resting {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        let place = f64::from(self.asked / ASKED);
        self.asked += 1;
        turned(self.middle, 0.1 * place, 1.0, frame)
    }

    fn is_over(&self) -> bool {
        self.asked > ASKED * self.places
    }
}

#[test]
fn what_is_seen_from_where_an_eye_rests_is_found_out_once() {
    let scene = small_scene();
    for cullers in [0, 1, 3] {
        let mut cameras = Resting { middle: middle(&scene), asked: 0, places: 5 };
        let mut frames = Frames::default();
        let session = LocalSession::new(&scene, settings(32, 2.0), 1);
        let session = LocalSession { pace: Pace::Live, cullers, ..session };
        play(session, |_| Device::default(), Device::default(), &mut cameras, &mut frames);
        assert_eq!(frames.0.len(), 5, "{cullers} cullers: {:?}", frames.0);
    }
}
