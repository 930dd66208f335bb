//! Visible sets that the sessions of one service share.

use std::{collections::VecDeque, sync::Arc};

use parking_lot::Mutex;
use tokio::sync::{Notify, futures::Notified};
use trimaran_proto::{Camera, DrawableId, FrameNumber, ViewState, ViewVersion};

/// How many sets are kept: displays of one view may be this many poses apart.
const KEPT: usize = 64;

/// The last sets that the sessions of a service have culled. A set is right for every display that looks from
/// the same pose with an equal view state, whatever occluders it was culled with. Clones are the same object.
#[derive(Debug, Clone, Default)]
pub(crate) struct SharedSets(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    sets: Mutex<VecDeque<Culled>>,
    /// There is another one.
    came: Notify,
}

#[derive(Debug)]
struct Culled {
    camera: Camera,
    state: Arc<ViewState>,
    ids: Arc<[DrawableId]>,
}

impl SharedSets {
    /// The set of this pose and view state, if another session has culled it. A session's own sets, which
    /// have its own `state`, do not count: where a display stands still, culling again draws less.
    pub(crate) fn get(&self, camera: Camera, state: &Arc<ViewState>) -> Option<Arc<[DrawableId]>> {
        let camera = pose(camera);
        let sets = self.0.sets.lock();
        let of_another = |set: &&Culled| !Arc::ptr_eq(&set.state, state);
        let equal = |set: &&Culled| set.camera == camera && set.state == *state;
        sets.iter().rev().filter(of_another).find(equal).map(|set| Arc::clone(&set.ids))
    }

    /// Keeps a set for the other sessions, if there are any.
    pub(crate) fn put(&self, camera: Camera, state: &Arc<ViewState>, ids: &[DrawableId]) {
        // One is held by the service, and one by each session.
        if Arc::strong_count(&self.0) <= 2 {
            return;
        }
        let set = Culled { camera: pose(camera), state: Arc::clone(state), ids: ids.into() };
        let mut sets = self.0.sets.lock();
        if sets.len() == KEPT {
            sets.pop_front();
        }
        sets.push_back(set);
        drop(sets);
        self.0.came.notify_waiters();
    }

    /// Ends when another set comes after this call.
    pub(crate) fn next(&self) -> Notified<'_> {
        self.0.came.notified()
    }
}

/// The camera without what differs between displays of one view.
const fn pose(camera: Camera) -> Camera {
    camera.for_frame(FrameNumber(0)).in_view(ViewVersion(0))
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{LodRule, Settings, Viewport};

    use super::*;

    fn camera(x: f64, frame: u32) -> Camera {
        Camera::new([x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 0.1, FrameNumber(frame)).unwrap()
    }

    fn state(epsilon: f64) -> Arc<ViewState> {
        let settings = Settings::new(Viewport::new(8, 8).unwrap(), LodRule::new(epsilon).unwrap());
        Arc::new(settings.into())
    }

    /// The sets of a service with this many sessions.
    fn sets(sessions: usize) -> (SharedSets, Vec<SharedSets>) {
        let sets = SharedSets::default();
        let sessions = vec![sets.clone(); sessions];
        (sets, sessions)
    }

    #[test]
    fn a_set_is_shared_by_pose_and_view_state_alone() {
        let (sets, _sessions) = sets(2);
        let ids = [DrawableId(3), DrawableId(1)];
        sets.put(camera(1.0, 5).in_view(ViewVersion(7)), &state(2.0), &ids);
        assert_eq!(sets.get(camera(1.0, 90), &state(2.0)).as_deref(), Some(&ids[..]), "in its order");
        assert_eq!(sets.get(camera(1.5, 5), &state(2.0)), None);
        assert_eq!(sets.get(camera(1.0, 5), &state(2.5)), None);
    }

    #[test]
    fn a_session_gets_no_set_of_its_own() {
        let (sets, _sessions) = sets(2);
        let state = state(2.0);
        sets.put(camera(1.0, 5), &state, &[DrawableId(3)]);
        assert_eq!(sets.get(camera(1.0, 6), &state), None);
        assert!(sets.get(camera(1.0, 6), &Arc::new((*state).clone())).is_some());
    }

    #[test]
    fn the_newest_are_kept() {
        let (sets, _sessions) = sets(2);
        for x in 0..100_u32 {
            sets.put(camera(x.into(), 0), &state(1.0), &[DrawableId(x)]);
        }
        let known = |x: u32| sets.get(camera(x.into(), 0), &state(1.0)).is_some();
        assert_eq!((0..100).filter(|x| known(*x)).collect::<Vec<_>>(), (36..100).collect::<Vec<_>>());
    }

    #[test]
    fn one_session_keeps_nothing() {
        let (sets, _session) = sets(1);
        sets.put(camera(1.0, 5), &state(2.0), &[DrawableId(3)]);
        assert_eq!(sets.get(camera(1.0, 5), &state(2.0)), None);
    }
}
