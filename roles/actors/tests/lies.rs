//! A peer that sends ids which no frame of the scene can have: unknown ones, one twice, more than there are.
//! Whoever receives them, the display or the other culler, leaves, says who did what, and is not misled.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

mod common;

use std::{sync::Arc, thread};

use common::{Broken, Device, Fault, Frames, Task};
use tokio::runtime::Runtime;
use trimaran_actors::{
    CullerIndex, CullerRole, DisplayRole, FrameStart, IdError, Link, RoleError, SceneCulling, ScenePictures,
    Stop, Turns, max_frame,
};
use trimaran_cook::generate::{PlantOptions, plant};
use trimaran_cook::{CookOptions, cook};
use trimaran_proto::{Camera, CloseCode, DrawableId, FrameNumber, Role};
use trimaran_scene::Scene;
use trimaran_transport::{CloseReason, Net, RecvError, TokioNet};

/// A device that is not to come as far as this.
fn must_not(come_to: Task) -> Device {
    Device::failing(come_to, 0, Fault::Fails(Broken::Lost))
}

fn still(frame: FrameNumber) -> Camera {
    Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.0, 0.1, frame).unwrap()
}

/// A scene, and roles within this process.
struct Setting {
    runtime: Runtime,
    net: Arc<dyn Net>,
    scene: Arc<Scene>,
}

impl Setting {
    fn new() -> Self {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let scene = Arc::new(cook(&plant(&PlantOptions::small(3)), &CookOptions::default(), &()).unwrap());
        Self { runtime, net, scene }
    }

    /// How many drawables there are.
    fn count(&self) -> u32 {
        max_frame(&self.scene)
    }

    fn link(&self, ours: Role, theirs: Role) -> (Link, Link) {
        common::link(&self.net, &self.scene, ours, theirs)
    }

    /// How a display ends whose first culler sends these ids, and what that one is told.
    fn display_gets(&self, ids: &[u32]) -> (RoleError, CloseReason) {
        let ((first, liar), (second, _idle)) =
            (self.link(Role::Display, Role::FirstCuller), self.link(Role::Display, Role::SecondCuller));
        let (settings, net) = (common::settings(8, 2.0), Arc::clone(&self.net));
        let work = ScenePictures::new(&self.scene, must_not(Task::Draw), &settings);
        let role = DisplayRole { work, first, second, settings, net, turns: Turns::at_once() };
        let runtime = self.runtime.handle();
        let (_stopper, stop) = Stop::new();
        thread::scope(|scope| {
            let ended = scope
                .spawn(|| runtime.block_on(role.run(&mut still, &mut Frames::default(), &stop)).unwrap_err());
            let told = self.runtime.block_on(lie(liar, ids));
            (ended.join().unwrap(), told)
        })
    }

    /// How the second culler ends whose peer sends these ids, and what that one is told.
    fn culler_gets(&self, ids: &[u32]) -> (RoleError, CloseReason) {
        let ((display, mut show), (other, liar)) =
            (self.link(Role::SecondCuller, Role::Display), self.link(Role::SecondCuller, Role::FirstCuller));
        show.latest_tx.publish(still(FrameNumber(1))).unwrap();
        let (settings, turns) = (common::settings(8, 2.0), Turns::at_once());
        let work = SceneCulling::new(&self.scene, must_not(Task::Finish), &settings, &turns);
        let index = CullerIndex::Second;
        let role = CullerRole { index, work, display, other, settings, turns };
        let runtime = self.runtime.handle();
        let (_stopper, stop) = Stop::new();
        thread::scope(|scope| {
            let ended = scope.spawn(|| runtime.block_on(role.run(&stop)).unwrap_err());
            let told = self.runtime.block_on(lie(liar, ids));
            (ended.join().unwrap(), told)
        })
    }

    /// How either of them ends, with what a peer is called there.
    fn both_get(&self, ids: &[u32]) -> [(&'static str, RoleError, CloseReason); 2] {
        let ((at_display, told), (at_culler, other_told)) = (self.display_gets(ids), self.culler_gets(ids));
        [("first culler", at_display, told), ("other culler", at_culler, other_told)]
    }
}

/// Sends a frame of these ids, as far as it is taken; gives what the peer says then.
async fn lie(mut link: Link, ids: &[u32]) -> CloseReason {
    let frame = FrameNumber(0);
    let ids: Vec<_> = ids.iter().copied().map(DrawableId).collect();
    link.frames_tx.begin(FrameStart { frame, header: still(frame) }).await.unwrap();
    for batch in ids.chunks(100) {
        if link.frames_tx.push(batch).await.is_err() {
            break;
        }
    }
    let _gone = link.frames_tx.finish().await;
    match link.frames_rx.recv().await {
        Err(RecvError::Closed { reason, .. }) => reason,
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_id_that_the_scene_does_not_have_ends_the_session_and_names_its_sender() {
    let setting = Setting::new();
    let count = setting.count();
    for id in [count, u32::MAX] {
        for (sender, error, told) in setting.both_get(&[0, 1, id]) {
            let RoleError::Ids { peer, cause } = error else { panic!("{error:?}") };
            assert_eq!(peer, sender);
            assert_eq!(cause, IdError::Unknown { id: DrawableId(id), count: count as usize });
            assert_eq!(CloseCode::of(&told), Some(CloseCode::Failed), "{told}");
        }
    }
}

#[test]
fn an_id_that_comes_twice_in_a_frame_ends_the_session_and_names_its_sender() {
    let setting = Setting::new();
    for (sender, error, told) in setting.both_get(&[4, 5, 4]) {
        let RoleError::Ids { peer, cause } = error else { panic!("{error:?}") };
        assert_eq!((peer, cause), (sender, IdError::Twice { id: DrawableId(4) }));
        assert_eq!(CloseCode::of(&told), Some(CloseCode::Failed), "{told}");
    }
}
