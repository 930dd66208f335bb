//! A path walked by the clock.

use std::time::Duration;

use trimaran_actors::Cameras;
use trimaran_proto::{Camera, FrameNumber};

use super::path::Trail;

/// The poses of a path at so many a second, from the moment the first one is asked for.
pub(super) struct LiveTrail<C> {
    trail: Trail,
    hz: f64,
    /// Time since some origin.
    clock: C,
    start: Option<Duration>,
}

impl<C: Fn() -> Duration> LiveTrail<C> {
    pub(super) const fn new(trail: Trail, hz: f64, clock: C) -> Self {
        Self { trail, hz, clock, start: None }
    }

    /// How many poses have been walked past.
    fn place(&self) -> usize {
        let start = self.start.unwrap_or_default();
        // Rounded down, and saturating for a walk of that many poses.
        ((self.clock)().saturating_sub(start).as_secs_f64() * self.hz) as usize
    }
}

impl<C: Fn() -> Duration> Cameras for LiveTrail<C> {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        if self.start.is_none() {
            self.start = Some((self.clock)());
        }
        self.trail.camera_at(self.place(), frame)
    }

    fn is_over(&self) -> bool {
        self.start.is_some() && self.place() >= self.trail.frames() as usize
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

    fn trail() -> Trail {
        let path = tempfile::NamedTempFile::new().unwrap();
        let pose = |x: u32| format!(r#"{{"eye":[{x},0,0],"forward":[0,0,-1],"up":[0,1,0]}}"#);
        let frames = (0..3).map(pose).collect::<Vec<_>>().join(",");
        std::fs::write(path.path(), format!(r#"{{"vfov_deg":60,"near":0.1,"frames":[{frames}]}}"#)).unwrap();
        let choice = PathChoice::File(path.path().to_owned());
        let scene = cook(&plant(&PlantOptions::small(1)), &CookOptions::default(), &()).unwrap();
        Trail::find(&choice, &scene, Viewport::new(8, 8).unwrap(), None).unwrap()
    }

    #[test]
    fn the_newest_pose_is_handed_out_until_the_walk_is_over() {
        let now = Cell::new(Duration::from_secs(5));
        let mut live = LiveTrail::new(trail(), 2.0, || now.get());
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
