//! A path at a pace: a frame a pose, or by the clock.

use std::time::Duration;

use trimaran_actors::{Cameras, Stopwatch};
use trimaran_proto::{Camera, FrameNumber};

use super::{path::CameraPath, plan::Pace};

impl CameraPath {
    /// The cameras of a session that walks it at this pace.
    #[must_use]
    pub fn cameras(&self, pace: Pace) -> Box<dyn Cameras> {
        match pace {
            Pace::Lockstep => Box::new(self.clone()),
            Pace::Live { hz } => {
                let clock = Stopwatch::start();
                Box::new(LivePath::new(self.clone(), hz, move || clock.elapsed()))
            }
        }
    }
}

/// The poses of a path at so many a second, from the moment the first one is asked for.
struct LivePath<C> {
    path: CameraPath,
    hz: f64,
    /// Time since some origin.
    clock: C,
    start: Option<Duration>,
}

impl<C: Fn() -> Duration> LivePath<C> {
    const fn new(path: CameraPath, hz: f64, clock: C) -> Self {
        Self { path, hz, clock, start: None }
    }

    /// How many poses have been walked past.
    fn walked(&self) -> usize {
        let start = self.start.unwrap_or_default();
        // Rounded down, and saturating for a walk of that many poses.
        ((self.clock)().saturating_sub(start).as_secs_f64() * self.hz) as usize
    }
}

impl<C: Fn() -> Duration> Cameras for LivePath<C> {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        if self.start.is_none() {
            self.start = Some((self.clock)());
        }
        self.path.camera_at(self.walked(), frame)
    }

    fn is_over(&self) -> bool {
        self.start.is_some() && self.walked() >= self.path.frames() as usize
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use trimaran_cook::{
        CookOptions, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_cull::Viewport;

    use super::*;
    use crate::walkthrough::PathChoice;

    fn path() -> CameraPath {
        let file = tempfile::NamedTempFile::new().unwrap();
        let pose = |x: u32| format!(r#"{{"eye":[{x},0,0],"forward":[0,0,-1],"up":[0,1,0]}}"#);
        let frames = (0..3).map(pose).collect::<Vec<_>>().join(",");
        std::fs::write(file.path(), format!(r#"{{"vfov_deg":60,"near":0.1,"frames":[{frames}]}}"#)).unwrap();
        let choice = PathChoice::File(file.path().to_owned());
        let scene = cook(&plant(&PlantOptions::small(1)), &CookOptions::default(), &()).unwrap();
        CameraPath::find(&choice, &scene, Viewport::new(8, 8).unwrap(), None).unwrap()
    }

    #[test]
    fn the_newest_pose_is_handed_out_until_the_walk_is_over() {
        let now = Cell::new(Duration::from_secs(5));
        let mut live = LivePath::new(path(), 2.0, || now.get());
        assert!(!live.is_over(), "the clock starts with the first camera");
        let mut poses = Vec::new();
        for ms in [5000, 5400, 5500, 6100, 6499, 6500] {
            now.set(Duration::from_millis(ms));
            poses.push((live.camera(FrameNumber(9)).eye()[0], live.is_over()));
        }
        let expected = [(0.0, false), (0.0, false), (1.0, false), (2.0, false), (2.0, false), (2.0, true)];
        assert_eq!(poses, expected);
        assert_eq!(live.camera(FrameNumber(9)).frame(), FrameNumber(9));
    }
}
