//! The limits and failures of a service's sessions: a failing one ends, its display hears why, and the others
//! go on.

use std::{
    sync::{Arc, OnceLock},
    thread,
    time::Duration,
};

use tokio::runtime::{Builder, Runtime};
use trimaran_actors::{
    Expected, FrameEvent, LimitError, Link, Meeting, NewSession, RoleError, SceneCulling, SessionLimits,
    Sharing, SlotGuard, Stop, Stopper, Turns, max_frame,
};
use trimaran_proto::{
    Camera, CloseCode, DrawableId, FrameNumber, Role, SessionKey, Settings, ViewState, ViewVersion, Viewport,
};
use trimaran_scene::Scene;
use trimaran_transport::{Net, Options, RecvError, TokioNet, until};

use crate::common::{Broken, Device, Fault, Task};

pub(crate) const SIDE: u32 = 64;
/// Bytes of depth of a session with such a picture.
const DEPTH: u64 = 14 * (SIDE * SIDE) as u64;

/// The eye of displays, looking along -z.
static EYE: OnceLock<[f64; 3]> = OnceLock::new();

/// A service, with the test playing its sessions and displays.
pub(crate) struct Service {
    pub(crate) runtime: Runtime,
    net: Arc<dyn Net>,
    pub(crate) scene: Arc<Scene>,
    turns: Turns,
    limits: SessionLimits,
}

/// The requests of a test's display.
struct PictureSizes {
    side: u32,
    /// In a view state sent after its first frame.
    later: u32,
}

const HONEST: PictureSizes = PictureSizes { side: SIDE, later: SIDE };

impl Service {
    /// Of pictures of `SIDE`, with memory for this many sessions.
    pub(crate) fn of(sessions: u64) -> Self {
        let runtime = Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let scene = crate::common::small_scene();
        // In front of it, so that there are boxes to test.
        let (min, max) = scene.nodes().first().unwrap().world_box();
        let middle = (min + max) / 2.0;
        EYE.get_or_init(|| [middle.x, middle.y, max.z + (max - min).max_element() / 4.0]);
        let most = Viewport::new(SIDE, SIDE).unwrap();
        let limits = SessionLimits::new(most, sessions * DEPTH);
        Self { runtime, net, scene, turns: Turns::fair(1), limits }
    }

    /// Runs a test's displays. Nothing here takes so long as its deadline.
    pub(crate) fn completes(&self, displays: impl Future<Output = ()>) {
        let deadline = self.net.now().after(Duration::from_secs(100));
        let completed = self.runtime.block_on(until(&*self.net, deadline, displays));
        assert!(completed.is_some(), "a display waits for something that does not come");
    }

    pub(crate) fn session(&self, side: u32) -> (NewSession, Link) {
        let settings = crate::common::settings(side, 2.0);
        let (display, far) = crate::common::link(&self.net, &self.scene, Role::Culler, Role::Display);
        let meeting = Meeting {
            net: Arc::clone(&self.net),
            scene: self.scene.outline(),
            settings,
            options: Options::default(),
            cullers: Arc::default(),
            expected: Expected::default(),
        };
        let (key, slot, sharing) = (SessionKey(1), SlotGuard::once(), Sharing::default());
        (NewSession { key, settings, display, meeting, slot, sharing }, far)
    }

    /// Plays a session on such a device; returns its end.
    pub(crate) fn play(&self, session: NewSession, device: Device, stop: &Stop) -> Result<(), RoleError> {
        self.supply(session, device, None, stop)
    }

    /// The same for a display that may hold no scene.
    pub(crate) fn supply(
        &self,
        session: NewSession,
        device: Device,
        scene: Option<&Arc<Scene>>,
        stop: &Stop,
    ) -> Result<(), RoleError> {
        let work = |settings: &Settings| Ok(SceneCulling::new(&self.scene, device, settings, &self.turns));
        let drawables = max_frame(&self.scene);
        self.runtime.block_on(session.play(work, &self.turns, drawables, scene, &self.limits, stop))
    }

    /// How a session with these requests ends, with the close and the frames that its display received.
    fn ends(&self, sizes: &PictureSizes, device: Device) -> (RoleError, String, u32) {
        let (session, far) = self.session(sizes.side);
        let (_stopper, stop) = Stop::new();
        let settings = session.settings;
        thread::scope(|scope| {
            let played = scope.spawn(|| self.play(session, device, &stop).unwrap_err());
            let state =
                ViewState { viewport: Viewport::new(sizes.later, sizes.later).unwrap(), ..settings.into() };
            let (told, seen) = self.runtime.block_on(walks(far, &state));
            (played.join().unwrap(), told, seen)
        })
    }

    /// A session that goes on beside others until it is stopped.
    fn honest<T>(&self, beside: impl FnOnce() -> T) -> T {
        let (session, mut far) = self.session(SIDE);
        let (stopper, stop) = Stop::new();
        thread::scope(|scope| {
            let played = scope.spawn(|| self.play(session, Device::default(), &stop));
            self.runtime.block_on(sees(&mut far, 0));
            let given = beside();
            self.runtime.block_on(sees(&mut far, 1));
            Stopper::stop(&stopper);
            drop(far);
            played.join().unwrap().unwrap();
            given
        })
    }
}

pub(crate) fn camera(frame: u32, version: u32) -> Camera {
    let camera =
        Camera::new(*EYE.get().unwrap(), [0.0, 0.0, 0.0, 1.0], 0.5, 0.1, FrameNumber(frame)).unwrap();
    camera.in_view(ViewVersion(version))
}

/// Requests a frame and waits for it.
async fn sees(link: &mut Link, frame: u32) {
    link.latest_tx.publish(camera(frame, 0)).unwrap();
    while !matches!(next(link).await.unwrap(), FrameEvent::End(_)) {}
}

/// The next event of frames. Other messages are read as well.
async fn next(link: &mut Link) -> Result<FrameEvent, RecvError> {
    loop {
        tokio::select! {
            event = link.frames_rx.recv() => return event,
            said = link.messages_rx.recv() => match said {
                Ok(_) => {}
                Err(end) => return Err(end),
            },
        }
    }
}

/// Requests one frame, and a second one in another view state. Returns the close, and how many whole frames
/// have come.
async fn walks(mut link: Link, state: &ViewState) -> (String, u32) {
    let _gone = link.latest_tx.publish(camera(0, 0));
    let mut seen = 0;
    loop {
        match next(&mut link).await {
            Ok(FrameEvent::End(_)) => {
                seen += 1;
                for message in state.to_messages(ViewVersion(1)).unwrap() {
                    let _gone = link.messages_tx.send(&message).await;
                }
                let _gone = link.latest_tx.publish(camera(seen, 1));
            }
            Ok(_) => {}
            Err(RecvError::Closed { reason, .. }) => {
                let code = CloseCode::of(&reason).unwrap();
                return (format!("{code:?}: {reason:?}"), seen);
            }
            Err(end) => panic!("{end}"),
        }
    }
}

#[test]
fn a_picture_above_the_limit_ends_its_session_and_no_other_one() {
    let service = Service::of(100);
    for (sizes, frames) in [
        (PictureSizes { side: SIDE + 1, later: SIDE }, 0),
        (PictureSizes { side: 65_536, later: SIDE }, 0),
        (PictureSizes { side: SIDE, later: SIDE + 1 }, 1),
        (PictureSizes { side: 1, later: 65_536 }, 1),
    ] {
        let (error, told, seen) = service.honest(|| service.ends(&sizes, Device::default()));
        assert!(matches!(error, RoleError::Limit(LimitError::Picture { .. })), "{error:?}");
        assert!(error.device_failure().is_none());
        assert!(told.starts_with("Failed") && told.contains("up to 64x64"), "{told}");
        assert_eq!(seen, frames);
    }
}

#[test]
fn memory_for_depth_is_bounded_over_all_sessions_and_free_once_one_ends() {
    let service = Service::of(1);
    let (error, told, _) = service.honest(|| service.ends(&HONEST, Device::default()));
    assert!(matches!(error, RoleError::Limit(LimitError::DepthMemory { free: 0, .. })), "{error:?}");
    assert!(told.starts_with("Failed") && told.contains("--depth-memory"), "{told}");
    // Its predecessor's memory is free again, even if that ended with a fault.
    let fails = || Device::failing(Task::Test, 0, Fault::Fails(Broken::NoMemory));
    for _ in 0..3 {
        let (error, ..) = service.ends(&HONEST, fails());
        assert!(matches!(error, RoleError::Session { .. }), "{error:?}");
    }
    service.honest(|| {});
}

#[test]
fn only_a_device_that_is_lost_or_hangs_is_the_end_of_the_process() {
    let service = Service::of(100);
    for task in [Task::Begin, Task::Finish, Task::Test] {
        for (broken, is_lost) in [(Broken::NoMemory, false), (Broken::Lost, true), (Broken::Hung, true)] {
            let fails = Device::failing(task, 1, Fault::Fails(broken));
            let (error, told, _) = service.honest(|| service.ends(&HONEST, fails));
            assert_eq!(error.device_failure().is_some(), is_lost, "{task:?}: {error:?}");
            let code = if is_lost { "DeviceFailed" } else { "Failed" };
            assert!(told.starts_with(code) && told.contains(&broken.to_string()), "{task:?}: {told}");
        }
    }
}

/// The ids of the frame for this camera.
pub(crate) async fn asks(link: &mut Link, camera: Camera) -> Vec<DrawableId> {
    link.latest_tx.publish(camera).unwrap();
    let mut ids = Vec::new();
    loop {
        match next(link).await.unwrap() {
            FrameEvent::Batch(batch) => ids.extend(batch.iter()),
            FrameEvent::End(_) => return ids,
            FrameEvent::Begin(start) => assert_eq!(start.header, camera),
        }
    }
}

/// The second display's device would fail.
#[test]
fn displays_of_one_view_are_culled_for_once() {
    let service = Service::of(100);
    let sharing = Sharing::default();
    let [(first, mut here), (second, mut there)] = [(); 2].map(|()| {
        let (session, far) = service.session(SIDE);
        (NewSession { sharing: sharing.clone(), ..session }, far)
    });
    let (stopper, stop) = Stop::new();
    let broken = Device::failing(Task::Begin, 0, Fault::Fails(Broken::NoMemory));
    thread::scope(|scope| {
        let culls = scope.spawn(|| service.play(first, Device::default(), &stop));
        let shares = scope.spawn(|| service.play(second, broken, &stop));
        service.runtime.block_on(async {
            for frame in 1..5 {
                let ids = asks(&mut here, camera(frame, 0)).await;
                assert!(!ids.is_empty());
                let shared = asks(&mut there, camera(frame + 100, 0)).await;
                assert_eq!(shared, ids, "in the same order");
            }
            // Another picture is another view.
            let settings = crate::common::settings(SIDE / 2, 2.0);
            for message in ViewState::from(settings).to_messages(ViewVersion(1)).unwrap() {
                there.messages_tx.send(&message).await.unwrap();
            }
            there.latest_tx.publish(camera(200, 1)).unwrap();
            while next(&mut there).await.is_ok() {}
        });
        let error = shares.join().unwrap().unwrap_err();
        assert!(matches!(error, RoleError::Session { .. }), "{error:?}");
        Stopper::stop(&stopper);
        drop(here);
        culls.join().unwrap().unwrap();
    });
}

#[test]
fn a_panic_ends_the_session_that_meets_it_and_the_others_have_their_turns() {
    let service = Service::of(1000);
    for task in [Task::Begin, Task::Draw, Task::Finish, Task::Test] {
        for good in [0, 1] {
            let fails = Device::failing(task, good, Fault::Panics);
            let (error, told, _) = service.honest(|| service.ends(&HONEST, fails));
            assert!(matches!(error, RoleError::Panic(_)) && error.device_failure().is_none(), "{error:?}");
            assert!(told.starts_with("Failed") && told.contains("a bug that only this session"), "{told}");
        }
    }
    // In the midst of opening it.
    let (session, far) = service.session(SIDE);
    let (_stopper, stop) = Stop::new();
    let state = session.settings.into();
    let open = |_: &Settings| -> Result<SceneCulling<Device>, RoleError> { panic!("it does not open") };
    let (played, told) = service.honest(|| {
        service.runtime.block_on(async {
            let (turns, limits) = (&service.turns, &service.limits);
            let playing = session.play(open, turns, max_frame(&service.scene), None, limits, &stop);
            tokio::join!(playing, walks(far, &state))
        })
    });
    assert!(matches!(played, Err(RoleError::Panic(_))), "{played:?}");
    assert!(told.0.contains("it does not open"), "{told:?}");
}
