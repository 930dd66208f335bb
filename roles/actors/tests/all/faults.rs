//! Cullers that die, stall, lie or fail: the display still shows every frame, in order and whole, and reports
//! each culler's fault.

use std::{collections::BTreeSet, sync::Arc, thread, time::Duration};

use tokio::runtime::Runtime;
use trimaran_actors::{
    Arrival, BoxedError, CullerEvent, CullerId, DisplayRole, LatestReceiver, Link, Observer, Pace, Peers,
    RoleError, SceneCulling, ScenePictures, ShownFrame, SlotGuard, Stop, Turns, max_frame,
};
use trimaran_cull::{LodRule, View, Viewport, lod_cut};
use trimaran_proto::{Camera, CloseCode, DrawableId, FrameNumber, Role, SessionKey};
use trimaran_scene::Scene;
use trimaran_transport::{CloseReason, Instant, Net, RecvError, TokioNet, sleep_until};

use crate::common::{Broken, Device, Fault, Task, runtime, send_frame, small_scene, turned};

const FRAMES: u32 = 12;
const SIDE: u32 = 64;
const EPSILON_PX: f64 = 2.0;

fn turning(frame: FrameNumber) -> Camera {
    turned([0.0; 3], 0.1 * f64::from(frame.0), 0.5, frame)
}

/// A scene, and a display within this process whose cullers a test plays itself.
struct Setting {
    runtime: Runtime,
    net: Arc<dyn Net>,
    scene: Arc<Scene>,
}

/// The frames that a display showed, and the events of its cullers.
#[derive(Debug, Default)]
struct Seen {
    frames: Vec<(u32, Option<CullerId>, BTreeSet<DrawableId>)>,
    late: Vec<CullerId>,
    left: Vec<(CullerId, String)>,
}

impl Observer for Seen {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        let ids = frame.ids.iter().copied().collect();
        self.frames.push((frame.camera.frame().0, frame.culler, ids));
        Ok(())
    }

    fn culler(&mut self, event: CullerEvent<'_>) {
        match event {
            CullerEvent::Late(id) => self.late.push(id),
            CullerEvent::Left(id, why) => self.left.push((id, trimaran_transport::causes(why))),
            _ => {}
        }
    }
}

/// The behaviour of a culler.
#[derive(Debug, Clone)]
enum Culler {
    /// Culls each of them.
    Sound,
    /// The same until this frame, then it goes without a close.
    DiesAt(u32),
    /// The same until this frame, then it is silent for ever.
    StallsAt(u32),
    /// The same, but this frame takes this long.
    SlowAt(u32, Duration),
    /// The same, but in this frame it sends one more id.
    LiesAt(u32, DrawableId),
    /// The same, but this frame it begins from another camera.
    LooksElsewhereAt(u32),
    /// The same, but it begins an unrequested frame instead of this one.
    RunsAheadAt(u32),
}

impl Setting {
    fn new() -> Self {
        let runtime = runtime();
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        Self { runtime, net, scene: small_scene() }
    }

    /// The visible set of a frame if nothing is hidden.
    fn visible(&self, camera: Camera) -> Vec<DrawableId> {
        let view = View::new(camera, Viewport::new(SIDE, SIDE).unwrap());
        lod_cut(&self.scene, &view, LodRule::new(EPSILON_PX).unwrap())
    }

    /// A display's record with such cullers, and the close that each culler receives, if it listens.
    fn play(
        &self,
        cullers: &[Culler],
        alone: Device,
    ) -> (Result<(), RoleError>, Seen, Vec<Option<CloseReason>>) {
        let (settings, turns) = (crate::common::settings(SIDE, EPSILON_PX), Turns::at_once());
        let mut peers = Peers::none();
        let mut far = Vec::new();
        for (place, culler) in cullers.iter().enumerate() {
            let (link, other) = crate::common::link(&self.net, &self.scene, Role::Display, Role::Culler);
            peers.put_back(Arrival { place, link, at: None, slot: SlotGuard::once() });
            far.push((culler, other));
        }
        let work = ScenePictures::new(&self.scene, Device::default(), &settings);
        let role = DisplayRole {
            alone: Some(SceneCulling::new(&self.scene, alone, &settings, &turns)),
            pace: Pace::Lockstep { frames: Some(FRAMES) },
            turns,
            ..DisplayRole::new(work, peers, SessionKey(1), settings, max_frame(&self.scene), &self.net)
        };
        let (_stopper, stop) = Stop::new();
        let mut seen = Seen::default();
        thread::scope(|scope| {
            let far: Vec<_> = far
                .into_iter()
                .map(|(culler, link)| scope.spawn(|| self.runtime.block_on(self.cull(culler, link))))
                .collect();
            let played = self.runtime.block_on(role.run(&mut turning, &mut seen, &stop));
            (played, seen, far.into_iter().map(|culler| culler.join().unwrap()).collect())
        })
    }

    /// Plays a culler; returns the close that it receives.
    async fn cull(&self, culler: &Culler, mut link: Link) -> Option<CloseReason> {
        for sent in 0.. {
            let mut camera = match next(&mut link.latest_rx).await {
                Ok(camera) => camera,
                Err(reason) => return reason,
            };
            let mut ids = self.visible(camera);
            match culler {
                Culler::DiesAt(frame) if camera.frame().0 >= *frame => return None,
                Culler::StallsAt(frame) if camera.frame().0 >= *frame => {
                    return loop {
                        if let Err(reason) = next(&mut link.latest_rx).await {
                            break reason;
                        }
                    };
                }
                Culler::SlowAt(frame, time) if camera.frame().0 == *frame => {
                    sleep_until(&*self.net, self.net.now().after(*time)).await;
                }
                Culler::LiesAt(frame, id) if camera.frame().0 == *frame => ids.push(*id),
                Culler::LooksElsewhereAt(frame) if camera.frame().0 == *frame => {
                    camera = turning(FrameNumber(frame + 1)).for_frame(FrameNumber(*frame));
                }
                Culler::RunsAheadAt(frame) if camera.frame().0 == *frame => {
                    camera = turning(FrameNumber(1000));
                }
                _ => {}
            }
            let _gone = send_frame(&mut link, sent, camera, &ids).await;
        }
        None
    }

    fn assert_whole(&self, seen: &Seen) {
        let numbers: Vec<_> = seen.frames.iter().map(|(frame, ..)| *frame).collect();
        assert_eq!(numbers, (0..FRAMES).collect::<Vec<_>>(), "{seen:?}");
        for (frame, by, ids) in &seen.frames {
            let visible: BTreeSet<_> = self.visible(turning(FrameNumber(*frame))).into_iter().collect();
            assert!(!visible.is_empty());
            assert_eq!(*ids, visible, "frame {frame} by {by:?}");
        }
    }
}

/// The next camera, or why there is none.
async fn next(cameras: &mut LatestReceiver) -> Result<Camera, Option<CloseReason>> {
    cameras.latest().await.map_err(|end| match end {
        RecvError::Closed { reason, .. } => Some(reason),
        _ => None,
    })
}

fn code(reason: &Option<CloseReason>) -> Option<CloseCode> {
    reason.as_ref().and_then(CloseCode::of)
}

#[test]
fn sound_cullers_cull_round_robin_and_are_told_when_the_session_is_over() {
    let setting = Setting::new();
    let (played, seen, told) = setting.play(&[Culler::Sound, Culler::Sound], Device::default());
    played.unwrap();
    setting.assert_whole(&seen);
    let by: Vec<_> = seen.frames.iter().map(|(_, by, _)| by.map(CullerId::index)).collect();
    assert_eq!(by, [Some(0), Some(1)].repeat(FRAMES as usize / 2));
    assert_eq!(told.iter().map(code).collect::<Vec<_>>(), [Some(CloseCode::Finished); 2]);
}

#[test]
fn whoever_dies_the_others_or_the_display_cull_its_frames() {
    let setting = Setting::new();
    for cullers in [
        vec![Culler::DiesAt(4), Culler::Sound],
        vec![Culler::Sound, Culler::DiesAt(0), Culler::Sound],
        vec![Culler::DiesAt(3), Culler::DiesAt(5), Culler::DiesAt(6)],
        vec![Culler::DiesAt(11)],
    ] {
        let (played, seen, _) = setting.play(&cullers, Device::default());
        played.unwrap();
        setting.assert_whole(&seen);
        let dead = cullers.iter().filter(|culler| matches!(culler, Culler::DiesAt(_))).count();
        assert_eq!(seen.left.len(), dead, "{seen:?}");
    }
}

#[test]
fn whoever_stalls_is_passed_over() {
    let setting = Setting::new();
    for cullers in [vec![Culler::StallsAt(4), Culler::Sound], vec![Culler::StallsAt(5)]] {
        let (played, seen, told) = setting.play(&cullers, Device::default());
        played.unwrap();
        setting.assert_whole(&seen);
        assert_eq!(seen.late.iter().map(|id| id.index()).collect::<Vec<_>>(), [0]);
        assert_eq!(code(&told[0]), Some(CloseCode::Finished), "it is told all the same");
    }
}

#[test]
fn who_answers_late_is_dealt_frames_again() {
    let setting = Setting::new();
    let slow = Culler::SlowAt(4, Duration::from_millis(1500));
    // The last frame takes long as well, so that it has time to answer.
    let cullers = [slow, Culler::SlowAt(FRAMES - 1, Duration::from_millis(900))];
    let (played, seen, _) = setting.play(&cullers, Device::default());
    played.unwrap();
    setting.assert_whole(&seen);
    assert_eq!(seen.late.first().map(|id| id.index()), Some(0), "{seen:?}");
    assert!(seen.left.is_empty());
}

#[test]
fn a_culler_that_breaks_the_rules_is_let_go_and_the_log_says_why() {
    let setting = Setting::new();
    let count = max_frame(&setting.scene);
    let twice = setting.visible(turning(FrameNumber(4)))[0];
    for (liar, why) in [
        (Culler::LiesAt(4, DrawableId(count)), format!("drawable {count} is not in this scene")),
        (Culler::LiesAt(4, DrawableId(u32::MAX)), "is not in this scene".to_owned()),
        (Culler::LiesAt(4, twice), format!("{twice} came twice in one frame")),
        (Culler::LooksElsewhereAt(4), "another camera than the display handed out".to_owned()),
        (Culler::RunsAheadAt(4), "which it was not dealt".to_owned()),
    ] {
        let (played, seen, told) = setting.play(&[liar, Culler::Sound], Device::default());
        played.unwrap();
        setting.assert_whole(&seen);
        let [(id, said)] = &seen.left[..] else { panic!("{seen:?}") };
        assert!(id.index() == 0 && said.contains("culler 1") && said.contains(&why), "{said}");
        assert_eq!(code(&told[0]), Some(CloseCode::Failed), "{told:?}");
        assert_eq!(code(&told[1]), Some(CloseCode::Finished), "{told:?}");
    }
}

/// Only failures of essentials end the session.
#[test]
fn a_display_whose_own_device_fails_tells_its_cullers() {
    let setting = Setting::new();
    let broken = Device::failing(Task::Finish, 0, Fault::Fails(Broken::Lost));
    let (played, _, told) = setting.play(&[Culler::DiesAt(0), Culler::StallsAt(0)], broken);
    let error = played.unwrap_err();
    assert!(error.device_failure().is_some(), "{error:?}");
    assert_eq!(code(&told[1]), Some(CloseCode::DeviceFailed), "{told:?}");
}

#[test]
fn waiting_for_ever_is_not_needed_to_notice_a_stall() {
    // The least time of a lockstep session, one second, and not the link's timeout of thirty.
    let setting = Setting::new();
    let began: Instant = setting.net.now();
    let (played, ..) = setting.play(&[Culler::StallsAt(6)], Device::default());
    played.unwrap();
    assert!(setting.net.now().since(began) < Duration::from_secs(15));
}
