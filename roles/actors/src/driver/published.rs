//! The published cameras, with those from which frames were culled.

use std::{
    collections::{BTreeMap, VecDeque},
    sync::Arc,
    time::Duration,
};

use trimaran_proto::{Camera, FrameNumber, ViewState, ViewVersion};

/// A source of cameras.
pub trait Cameras {
    /// The pose for this frame. In a lockstep session it depends only on the frame; in a live one it is the
    /// newest.
    fn camera(&mut self, frame: FrameNumber) -> Camera;

    /// A view state named by one of its cameras, of version 1 or later. It may be requested until its frames
    /// are shown.
    fn view_state(&mut self, version: ViewVersion) -> Option<Arc<ViewState>> {
        let _ = version;
        None
    }

    /// Whether the walk is over, which ends a live session; one in lockstep has a given number of frames.
    fn is_over(&self) -> bool {
        false
    }
}

/// A function of the frame's number. The view state does not change.
impl<F: FnMut(FrameNumber) -> Camera> Cameras for F {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        self(frame)
    }
}

/// The published cameras of frames that are not shown yet, oldest first, with their times.
#[derive(Debug, Default)]
pub(super) struct Published(BTreeMap<FrameNumber, VecDeque<(Camera, Duration)>>);

impl Published {
    /// About a second of poses for a frame. Beyond, the oldest are dropped.
    const KEPT: usize = 256;

    pub(super) fn note(&mut self, camera: Camera, at: Duration) {
        let poses = self.0.entry(camera.frame()).or_default();
        if poses.len() == Self::KEPT {
            poses.pop_front();
        }
        poses.push_back((camera, at));
    }

    /// When this camera was first published; none if it was not.
    pub(super) fn when(&self, camera: &Camera) -> Option<Duration> {
        let poses = self.0.get(&camera.frame())?;
        poses.iter().find(|(pose, _)| pose == camera).map(|(_, at)| *at)
    }

    /// The newest pose for this frame.
    pub(super) fn newest(&self, frame: FrameNumber) -> Option<Camera> {
        self.0.get(&frame)?.back().map(|(camera, _)| *camera)
    }

    /// Drops the cameras of frames up to `shown`.
    pub(super) fn shown(&mut self, shown: FrameNumber) {
        self.0 = self.0.split_off(&FrameNumber(shown.0.saturating_add(1)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(x: f64, frame: u32) -> Camera {
        Camera::new([x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 0.1, FrameNumber(frame)).unwrap()
    }

    #[test]
    fn a_frame_is_as_old_as_the_camera_it_was_culled_from() {
        let mut published = Published::default();
        for (x, at) in [(0.0, 10), (1.0, 20), (2.0, 30)] {
            published.note(camera(x, 4), Duration::from_millis(at));
        }
        assert_eq!(published.newest(FrameNumber(4)), Some(camera(2.0, 4)));
        assert_eq!(
            published.when(&camera(1.0, 4)),
            Some(Duration::from_millis(20)),
            "the newest was too late"
        );
        assert_eq!(published.when(&camera(7.0, 4)), None, "nobody handed it out");
        published.shown(FrameNumber(4));
        assert_eq!(published.newest(FrameNumber(4)), None);
    }

    #[test]
    fn a_culler_that_takes_long_does_not_make_the_list_grow() {
        let mut published = Published::default();
        for n in 0..1000u32 {
            published.note(camera(f64::from(n), 4), Duration::from_millis(n.into()));
        }
        assert_eq!(published.0[&FrameNumber(4)].len(), Published::KEPT);
        assert_eq!(published.when(&camera(999.0, 4)), Some(Duration::from_millis(999)));
    }
}
