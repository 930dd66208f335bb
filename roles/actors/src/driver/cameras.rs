//! Which cameras the display has handed out, and which of them a frame was culled from.

use std::{collections::VecDeque, time::Duration};

use trimaran_proto::{Camera, FrameNumber};
use trimaran_transport::SendError;

use crate::{clock::Stopwatch, links::LatestSender, machine::CullerIndex};

/// Where cameras come from.
pub trait Cameras {
    /// The pose for this frame. In a lockstep session it depends on the frame alone; in a live one it is the
    /// newest there is.
    fn camera(&mut self, frame: FrameNumber) -> Camera;

    /// Whether the walk is over. A live session ends then; one in lockstep has as many frames as its settings
    /// say.
    fn is_over(&self) -> bool {
        false
    }
}

/// A function of the frame's number.
impl<F: FnMut(FrameNumber) -> Camera> Cameras for F {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        self(frame)
    }
}

/// The cameras handed out for the next frame of each culler.
#[derive(Debug)]
pub(super) struct PublishedCameras {
    clock: Stopwatch,
    cullers: [Pending; 2],
}

impl PublishedCameras {
    pub(super) fn new(clock: Stopwatch) -> Self {
        Self { clock, cullers: Default::default() }
    }

    /// Publishes `camera` to the culler of its frame.
    pub(super) fn publish(&mut self, camera: Camera, to: &mut LatestSender) -> Result<(), SendError> {
        self.cullers[CullerIndex::of(camera.frame()).index()].note(camera, self.clock.elapsed());
        to.publish(camera)
    }

    /// The newer pose for that culler's next frame, if there is one.
    pub(super) fn newer(&self, index: CullerIndex, cameras: &mut dyn Cameras) -> Option<Camera> {
        let last = self.cullers[index.index()].newest()?;
        Some(cameras.camera(last.frame())).filter(|camera| *camera != last)
    }

    /// A culler began its frame from `camera`: says when that was handed out. Its next frame starts anew.
    pub(super) fn taken(&mut self, camera: &Camera) -> Duration {
        self.cullers[CullerIndex::of(camera.frame()).index()].take(camera)
    }
}

/// The cameras handed out for one frame, oldest first, and when: which of them its culler took, the frame
/// says.
#[derive(Debug, Default)]
struct Pending(VecDeque<(Camera, Duration)>);

impl Pending {
    /// About a second of them. Beyond, the oldest are forgotten, and a frame from one of those counts as from
    /// the oldest kept.
    const KEPT: usize = 256;

    fn note(&mut self, camera: Camera, at: Duration) {
        if self.0.len() == Self::KEPT {
            self.0.pop_front();
        }
        self.0.push_back((camera, at));
    }

    fn newest(&self) -> Option<Camera> {
        self.0.back().map(|(camera, _)| *camera)
    }

    fn take(&mut self, camera: &Camera) -> Duration {
        let taken = self.0.iter().rposition(|(handed, _)| handed == camera);
        let at = self.0.get(taken.unwrap_or(0)).map_or(Duration::ZERO, |(_, at)| *at);
        self.0.clear();
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(x: f64) -> Camera {
        Camera::new([x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 1.0, 0.1, FrameNumber(4)).unwrap()
    }

    #[test]
    fn a_frame_is_as_old_as_the_camera_it_was_culled_from() {
        let mut pending = Pending::default();
        for (x, at) in [(0.0, 10), (1.0, 20), (2.0, 30)] {
            pending.note(camera(x), Duration::from_millis(at));
        }
        assert_eq!(pending.newest(), Some(camera(2.0)));
        assert_eq!(pending.take(&camera(1.0)), Duration::from_millis(20), "the newest came too late for it");
        assert_eq!(pending.newest(), None, "what is left was for that frame as well");
    }

    #[test]
    fn a_culler_that_takes_long_does_not_make_the_list_grow() {
        let mut pending = Pending::default();
        for n in 0..1000u32 {
            pending.note(camera(f64::from(n)), Duration::from_millis(n.into()));
        }
        assert_eq!(pending.0.len(), Pending::KEPT);
        assert_eq!(pending.take(&camera(0.0)), Duration::from_millis(1000 - 256), "the oldest kept");
    }

    #[test]
    fn only_a_pose_that_has_moved_is_handed_out_again() {
        let mut handed = PublishedCameras::new(Stopwatch::start());
        let [mut still, mut moved] = [0.0, 7.0].map(|x| move |frame| camera(x).for_frame(frame));
        assert_eq!(handed.newer(CullerIndex::First, &mut moved), None, "no frame of this culler is due");
        handed.cullers[0].note(camera(0.0), Duration::ZERO);
        assert_eq!(handed.newer(CullerIndex::First, &mut still), None);
        assert_eq!(handed.newer(CullerIndex::First, &mut moved), Some(camera(7.0)));
        assert_eq!(handed.newer(CullerIndex::Second, &mut moved), None);
    }
}
