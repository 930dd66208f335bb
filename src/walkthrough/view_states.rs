//! The view states of a walk: the first one, and those that follow.

use std::sync::Arc;

use trimaran_cull::{CutRule, View};
use trimaran_proto::{Camera, Settings, ViewState, ViewVersion};
use trimaran_scene::Scene;

/// The view states of a walk. Version 0 comes from the plan; later ones come along the path.
#[derive(Debug, Clone)]
pub struct ViewStates {
    first: Arc<ViewState>,
    later: Arc<[ViewChange]>,
}

/// A view state that holds from a place of the path on.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewChange {
    /// The first pose of the path with it, counted from 0. In lockstep that is the frame.
    pub pose: u32,
    /// The view state.
    pub state: Arc<ViewState>,
}

impl ViewStates {
    /// The first one, and changes in the order of their poses.
    #[must_use]
    pub fn new(first: ViewState, mut later: Vec<ViewChange>) -> Self {
        later.sort_by_key(|change| change.pose);
        Self { first: Arc::new(first), later: later.into() }
    }

    /// The changes, that of version 1 first.
    #[must_use]
    pub fn later(&self) -> &[ViewChange] {
        &self.later
    }

    /// The version at a pose of the path.
    #[must_use]
    pub fn version_at(&self, pose: u32) -> ViewVersion {
        let before = self.later.partition_point(|change| change.pose <= pose);
        ViewVersion(u32::try_from(before).unwrap_or(u32::MAX))
    }

    /// A view state by its version.
    #[must_use]
    pub fn get(&self, version: ViewVersion) -> Option<&Arc<ViewState>> {
        match version.0.checked_sub(1) {
            None => Some(&self.first),
            Some(later) => self.later.get(later as usize).map(|change| &change.state),
        }
    }

    /// The view from a camera of the walk.
    #[must_use]
    pub fn view(&self, camera: Camera) -> View {
        View::of(camera, self.of(&camera))
    }

    /// The rule of the LOD cut for a camera of the walk.
    #[must_use]
    pub fn rule(&self, scene: &Scene, camera: &Camera) -> CutRule {
        CutRule::new(scene, self.of(camera))
    }

    pub(super) fn of(&self, camera: &Camera) -> &ViewState {
        self.get(camera.view()).unwrap_or(&self.first)
    }
}

/// A view state that never changes.
impl From<Settings> for ViewStates {
    fn from(settings: Settings) -> Self {
        Self::new(settings.into(), Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{LodRule, Viewport};

    use super::*;

    #[test]
    fn a_pose_is_seen_in_the_last_change_before_it() {
        let settings = Settings::new(Viewport::new(8, 8).unwrap(), LodRule::new(1.0).unwrap());
        let state = |side| ViewState { viewport: Viewport::new(side, side).unwrap(), ..settings.into() };
        let change = |pose, side| ViewChange { pose, state: Arc::new(state(side)) };
        let states = ViewStates::new(settings.into(), vec![change(5, 50), change(2, 20)]);
        let sides: Vec<_> =
            (0..7).map(|pose| states.get(states.version_at(pose)).unwrap().viewport.width()).collect();
        assert_eq!(sides, [8, 8, 20, 20, 20, 50, 50]);
        assert_eq!(states.get(ViewVersion(3)), None);
        assert_eq!(ViewStates::from(settings).version_at(9), ViewVersion(0));
    }
}
