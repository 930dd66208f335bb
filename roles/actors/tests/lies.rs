//! A peer that sends ids which no frame of the scene can have: unknown ones, one twice, more than there are.
//! Whoever receives them, the display or the other culler, leaves, says who did what, and is not misled.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

use std::{convert::Infallible, sync::Arc, thread, time::Duration};

use tokio::runtime::Runtime;
use trimaran_actors::{
    BoxedError, Cameras, CullerDevice, CullerIndex, CullerRole, DisplayRole, FrameStart, IdError, Link,
    Observer, PictureDevice, RoleError, SceneCulling, ScenePictures, ShownFrame, Stop, Turns, max_frame,
};
use trimaran_cook::generate::{PlantOptions, plant};
use trimaran_cook::{CookOptions, cook};
use trimaran_cull::{DepthImage, Image, OcclusionTest, TestBox, View};
use trimaran_proto::{
    BatchSize, Camera, CloseCode, DrawableId, FrameNumber, IdCoding, Identity, LodRule, OcclusionTestKind,
    Role, SceneHash, Settings, Viewport, Walkthrough,
};
use trimaran_scene::Scene;
use trimaran_transport::{CloseReason, LinkConfig, Net, RecvError, TokioNet, inproc};

/// A device that has nothing to do.
struct Idle;

impl PictureDevice for Idle {
    type Error = Infallible;

    fn draw(&mut self, _: &View, ids: &[DrawableId]) -> Result<(), Infallible> {
        panic!("a frame of {} ids was drawn", ids.len());
    }

    fn read(&mut self, _: &mut Image) -> Result<(), Infallible> {
        Ok(())
    }
}

impl OcclusionTest for Idle {
    type Error = Infallible;

    fn test(&mut self, _: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
        visible.clear();
        visible.resize(boxes.len(), 1);
        Ok(())
    }
}

impl CullerDevice for Idle {
    fn begin_occluders(&mut self, _: &View) -> Result<(), Infallible> {
        Ok(())
    }

    fn draw_occluders(&mut self, _: &[DrawableId]) -> Result<(), Infallible> {
        Ok(())
    }

    fn finish_occluders(&mut self) -> Result<Duration, Infallible> {
        panic!("all occluders were taken")
    }

    fn read_depth(&mut self) -> Result<DepthImage<'_>, Infallible> {
        panic!("nobody asks for it")
    }
}

struct Still;

impl Cameras for Still {
    fn camera(&mut self, frame: FrameNumber) -> Camera {
        Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.0, 0.1, frame).unwrap()
    }
}

struct Nobody;

impl Observer for Nobody {
    fn shown(&mut self, _: &ShownFrame<'_>) -> Result<(), BoxedError> {
        Ok(())
    }
}

fn settings() -> Settings {
    Settings {
        viewport: Viewport::new(8, 8).unwrap(),
        lod: LodRule::new(2.0).unwrap(),
        batch: BatchSize::default(),
        coding: IdCoding::Plain,
        occlusion_test: OcclusionTestKind::Raster,
        lockstep: true,
        first: FrameNumber(0),
        frames: None,
    }
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
        let identity = |role| Identity { role, scene: SceneHash(1), settings: None };
        let config = LinkConfig { max_frame: self.count(), ..LinkConfig::default() };
        inproc::pair::<Walkthrough>(&self.net, identity(ours), identity(theirs), &config).unwrap()
    }

    /// How a display ends whose first culler sends these ids, and what that one is told.
    fn display_gets(&self, ids: &[u32]) -> (RoleError, CloseReason) {
        let ((first, liar), (second, _idle)) =
            (self.link(Role::Display, Role::FirstCuller), self.link(Role::Display, Role::SecondCuller));
        let (settings, net) = (settings(), Arc::clone(&self.net));
        let work = ScenePictures::new(&self.scene, Idle, &settings);
        let role = DisplayRole { work, first, second, settings, net, turns: Turns::at_once() };
        let runtime = self.runtime.handle();
        let (_stopper, stop) = Stop::new();
        thread::scope(|scope| {
            let ended =
                scope.spawn(|| runtime.block_on(role.run(&mut Still, &mut Nobody, &stop)).unwrap_err());
            let told = self.runtime.block_on(lie(liar, ids));
            (ended.join().unwrap(), told)
        })
    }

    /// How the second culler ends whose peer sends these ids, and what that one is told.
    fn culler_gets(&self, ids: &[u32]) -> (RoleError, CloseReason) {
        let ((display, mut show), (other, liar)) =
            (self.link(Role::SecondCuller, Role::Display), self.link(Role::SecondCuller, Role::FirstCuller));
        show.latest_tx.publish(Still.camera(FrameNumber(1))).unwrap();
        let (settings, turns) = (settings(), Turns::at_once());
        let work = SceneCulling::new(&self.scene, Idle, &settings, &turns);
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
    link.frames_tx.begin(FrameStart { frame, header: Still.camera(frame) }).await.unwrap();
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
