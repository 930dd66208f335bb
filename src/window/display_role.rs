//! The display role beside the window: it publishes the newest pose, and passes on the cullers' sets. It
//! draws nothing, as the window does so from a newer pose.

use std::{
    collections::VecDeque,
    sync::{Arc, mpsc},
    time::Duration,
};

use parking_lot::Mutex;
use trimaran_actors::{BoxedError, Cameras, DisplayWork, Observer, RoleError, ShownFrame};
use trimaran_cull::Image;
use trimaran_proto::{Camera, DrawableId, FrameNumber, ViewState, ViewVersion};

/// The set that a culler has found for a camera.
#[derive(Debug, Clone)]
pub(super) struct FoundSet {
    pub(super) camera: Camera,
    pub(super) ids: Vec<DrawableId>,
    /// When the camera was published, since the session's start.
    pub(super) posed: Duration,
    /// When the set arrived.
    pub(super) came: Duration,
    /// Whether it has no stand-ins.
    pub(super) is_whole: bool,
}

/// The camera and view state for the next frame to cull: the window sets it, the role reads it.
#[derive(Debug, Clone)]
pub(super) struct Wish(Arc<Mutex<Wished>>);

#[derive(Debug)]
struct Wished {
    camera: Camera,
    /// The view states of frames under way, the newest one last.
    states: VecDeque<(ViewVersion, Arc<ViewState>)>,
}

impl Wish {
    /// A camera with version 0.
    pub(super) fn new(camera: Camera) -> Self {
        Self(Arc::new(Mutex::new(Wished { camera, states: VecDeque::new() })))
    }

    /// Sets the camera, with the newest view state. Returns it as later sets name it.
    pub(super) fn look(&self, camera: Camera) -> Camera {
        let mut wished = self.0.lock();
        let version = wished.version();
        wished.camera = camera.in_view(version);
        wished.camera
    }

    /// The same with another view state from now on.
    pub(super) fn change(&self, state: ViewState, camera: Camera) -> Camera {
        let mut wished = self.0.lock();
        let version = ViewVersion(wished.version().0.saturating_add(1));
        wished.states.push_back((version, Arc::new(state)));
        wished.camera = camera.in_view(version);
        wished.camera
    }

    /// A frame of this version was found, so earlier versions are no longer needed.
    pub(super) fn seen_in(&self, version: ViewVersion) {
        self.0.lock().states.retain(|(known, _)| *known >= version);
    }
}

impl Wished {
    fn version(&self) -> ViewVersion {
        self.states.back().map(|(version, _)| *version).unwrap_or_default()
    }
}

impl Cameras for Wish {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        self.0.lock().camera.for_frame(frame)
    }

    fn view_state(&mut self, version: ViewVersion) -> Option<Arc<ViewState>> {
        let wished = self.0.lock();
        wished.states.iter().find(|(known, _)| *known == version).map(|(_, state)| Arc::clone(state))
    }
}

/// Leaves drawing to the window.
pub(super) struct DrawsNothing;

impl DisplayWork for DrawsNothing {
    fn draws_at_once(&self) -> bool {
        false
    }

    async fn draw(&mut self, _: Camera, _: &mut Vec<DrawableId>, _: u32) -> Result<usize, RoleError> {
        Ok(0)
    }

    fn picture(&mut self) -> Result<Option<&Image>, RoleError> {
        Ok(None)
    }
}

/// Passes on sets, and wakes the window.
pub(super) struct PassesOn<F> {
    pub(super) sets: mpsc::Sender<FoundSet>,
    pub(super) wake: F,
}

impl<F: Fn()> Observer for PassesOn<F> {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        let ShownFrame { camera, ids, published: posed, shown: came, lacking, .. } = *frame;
        // The role stops when the window has gone.
        let _gone =
            self.sets.send(FoundSet { camera, ids: ids.to_vec(), posed, came, is_whole: lacking == 0 });
        (self.wake)();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use trimaran_cull::{LodRule, Viewport};
    use trimaran_proto::Settings;

    use super::*;

    #[test]
    fn a_camera_is_seen_in_the_view_state_that_was_wished_last() {
        let at_origin = Camera::at_origin(FrameNumber(0));
        let mut wish = Wish::new(at_origin);
        assert_eq!(wish.camera(FrameNumber(7)), at_origin.for_frame(FrameNumber(7)));
        let state = |side| {
            let settings = Settings::new(Viewport::new(side, side).unwrap(), LodRule::new(2.0).unwrap());
            ViewState::from(settings)
        };
        for side in 1..=100 {
            wish.change(state(side), at_origin);
        }
        assert_eq!(wish.camera(FrameNumber(0)).view(), ViewVersion(100));
        wish.look(Camera::new([1.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 0.1, FrameNumber(0)).unwrap());
        let camera = wish.camera(FrameNumber(3));
        assert_eq!((camera.view(), camera.eye()), (ViewVersion(100), [1.0; 3]));
        assert_eq!(*wish.view_state(ViewVersion(100)).unwrap(), state(100));
        assert_eq!(*wish.view_state(ViewVersion(1)).unwrap(), state(1), "it may be under way");
        wish.seen_in(ViewVersion(50));
        assert_eq!(*wish.view_state(ViewVersion(50)).unwrap(), state(50));
        assert_eq!(wish.view_state(ViewVersion(49)), None);
    }
}
