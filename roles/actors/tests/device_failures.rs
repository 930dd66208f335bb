//! Devices that fail or hang: the peers learn why, wait for the role as for one that was lost, and the
//! session goes on when it comes again. Whoever asks a role to stop does not wait for its device.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

mod common;

use std::{
    sync::{
        Arc,
        mpsc::{Receiver, channel},
    },
    thread,
    time::Duration,
};

use common::{Broken, Device, Fault, Frames, Task};
use glam::DVec3;
use tokio::runtime::{Builder, Handle, Runtime};
use trimaran_actors::{
    Cameras, CullerIndex, CullerRole, DisplayRole, FrameStart, Joined, Link, Listener, PeerEndpoint,
    RoleError, SceneCulling, ScenePictures, Stop, Stopper, Turns, await_cullers, join_session,
};
use trimaran_audit::cases;
use trimaran_cull::{Culler, LodRule, NoOccluders, View, Viewport};
use trimaran_proto::{Camera, CloseCode, FrameNumber, Identity, Role, Settings};
use trimaran_scene::Scene;
use trimaran_transport::{CloseReason, Instant, Net, Options, RecvError, TokioNet};

/// How many frames a session has.
const FRAMES: u32 = 12;

/// The session's picture, in which something is so near that its parts are looked at.
const SIDE: u32 = 64;
const EPSILON_PX: f64 = 0.5;

/// A scene, a camera in it, and endpoints that no other test has.
struct House {
    runtime: Runtime,
    net: Arc<dyn Net>,
    scene: Arc<Scene>,
    camera: Camera,
    name: String,
}

/// How the three roles of a session ended, and the frames shown.
struct Ends {
    cullers: [Result<(), RoleError>; 2],
    display: Result<(), RoleError>,
    shown: Vec<u32>,
}

impl House {
    fn new(name: &str) -> Self {
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
        let scene = cases::plant(7, 60, DVec3::ZERO).unwrap();
        let size = Viewport::new(SIDE, SIDE).unwrap();
        let views = cases::plant_views(7, 60, DVec3::ZERO, size, 30).unwrap();
        let (mut culler, rule) = (Culler::new(Arc::clone(&scene)), LodRule::new(EPSILON_PX).unwrap());
        let mut tested = |view: &View| culler.cull(view, rule, &mut NoOccluders, |_| {}).unwrap().tested;
        let camera = *views.iter().find(|view| tested(view) > 0).unwrap().camera();
        Self { runtime, net, scene, camera, name: name.to_owned() }
    }

    fn settings(&self, first: u32) -> Settings {
        let first = FrameNumber(first);
        Settings { first, frames: Some(FRAMES), ..common::settings(SIDE, EPSILON_PX) }
    }

    /// A camera that stands still.
    fn still(&self) -> impl Cameras + use<> {
        let camera = self.camera;
        move |frame| camera.for_frame(frame)
    }

    fn endpoint(&self, what: &str) -> PeerEndpoint {
        PeerEndpoint {
            endpoint: format!("inproc:{}-{what}", self.name).parse().unwrap(),
            options: Options::default(),
        }
    }

    fn deadline(&self) -> Instant {
        self.net.now().after(Duration::from_secs(600))
    }

    /// The three roles with these devices join, and play from the frame `first` on until all have ended.
    fn session(&self, first: u32, cullers: [Device; 2], display: Device) -> Ends {
        let ((_stopper, stop), settings) = (Stop::new(), self.settings(first));
        let identity = Identity { role: Role::Display, scene: self.scene.hash(), settings: Some(settings) };
        let PeerEndpoint { endpoint, options } = self.endpoint("display");
        let handle = self.runtime.handle();
        let listener = handle.block_on(Listener::bind(&self.net, &endpoint, identity, &options)).unwrap();
        thread::scope(|scope| {
            let stop = &stop;
            let culler = |index, device| {
                scope.spawn(move || {
                    let (display, meet) = (self.endpoint("display"), self.endpoint("meet"));
                    let joining =
                        join_session(&self.net, index, self.scene.hash(), &display, &meet, self.deadline());
                    let Joined { display, other, settings } = handle.block_on(joining).unwrap();
                    let role = self.culler(index, device, display, other, settings);
                    handle.block_on(role.run(stop))
                })
            };
            let [one, two] = cullers;
            let cullers = [culler(CullerIndex::First, one), culler(CullerIndex::Second, two)];
            let [first, second] = handle.block_on(await_cullers(listener, self.deadline())).unwrap();
            let role = self.display(display, first, second, settings);
            let mut frames = Frames::default();
            let display = handle.block_on(role.run(&mut self.still(), &mut frames, stop)).map(|_| ());
            Ends { cullers: cullers.map(|role| role.join().unwrap()), display, shown: frames.0 }
        })
    }

    fn culler(
        &self,
        index: CullerIndex,
        device: Device,
        display: Link,
        other: Link,
        settings: Settings,
    ) -> CullerRole<SceneCulling<Device>> {
        let turns = Turns::at_once();
        let work = SceneCulling::new(&self.scene, device, &settings, &turns);
        CullerRole { index, work, display, other, settings, turns }
    }

    fn display(
        &self,
        device: Device,
        first: Link,
        second: Link,
        settings: Settings,
    ) -> DisplayRole<ScenePictures<Device>> {
        let (net, turns) = (Arc::clone(&self.net), Turns::at_once());
        let work = ScenePictures::new(&self.scene, device, &settings);
        DisplayRole { work, first, second, settings, net, turns }
    }

    /// A link of a role to a peer that the test plays.
    fn link(&self, ours: Role, theirs: Role) -> (Link, Link) {
        common::link(&self.net, &self.scene, ours, theirs)
    }
}

fn broken_by(error: &RoleError) -> Option<&Broken> {
    error.device_failure()?.downcast_ref()
}

/// Goes on with the frame that was due, with devices that work, and asserts that no frame is missing and none
/// was shown twice.
fn assert_goes_on(house: &House, shown: Vec<u32>) {
    let due = shown.len() as u32;
    assert!(due < FRAMES, "it failed within the session");
    let ends = house.session(due, Default::default(), Device::default());
    assert!(ends.cullers.iter().all(Result::is_ok) && ends.display.is_ok());
    assert_eq!([shown, ends.shown].concat(), (0..FRAMES).collect::<Vec<_>>());
}

#[test]
fn a_session_goes_on_when_the_machine_whose_device_failed_comes_again() {
    let faults = [(Task::Finish, Broken::Lost), (Task::Test, Broken::Hung), (Task::Begin, Broken::Hung)];
    for (index, (task, broken)) in faults.into_iter().enumerate() {
        for failing in [0, 1] {
            let house = House::new(&format!("machine-{index}-{failing}"));
            let mut devices = [Device::default(), Device::default()];
            devices[failing] = Device::failing(task, 2, Fault::Fails(broken));
            let Ends { cullers, display, shown } = house.session(0, devices, Device::default());
            let (failed, other) =
                (cullers[failing].as_ref().unwrap_err(), cullers[1 - failing].as_ref().unwrap_err());
            assert_eq!(broken_by(failed), Some(&broken), "{failed:?}");
            assert!(!failed.lost_a_peer() && !failed.is_clean_end(), "its process ends: {failed:?}");
            // Either hears it from the culler itself, or that the other has lost it.
            for peer in [other, display.as_ref().unwrap_err()] {
                assert!(peer.lost_a_peer(), "{task:?} {broken}: {peer:?}");
                let said = format!("{peer:?}");
                assert!(said.contains(&broken.to_string()) || said.contains("PeerLost"), "{said}");
            }
            assert_goes_on(&house, shown);
        }
    }
}

#[test]
fn a_session_goes_on_when_the_display_whose_device_failed_comes_again() {
    let house = House::new("display");
    let broken = Device::failing(Task::Draw, 4, Fault::Fails(Broken::Hung));
    let Ends { cullers, display, shown } = house.session(0, Default::default(), broken);
    assert_eq!(broken_by(&display.unwrap_err()), Some(&Broken::Hung));
    for peer in cullers {
        assert!(peer.as_ref().unwrap_err().lost_a_peer(), "{peer:?}");
    }
    assert_eq!(shown, [0, 1, 2, 3]);
    assert_goes_on(&house, shown);
}

/// Plays `role` on a thread until its device hangs, asks it to stop, and gives how it ended.
fn stopped<T: Send>(hangs: Receiver<()>, stopper: Stopper, role: impl FnOnce() -> T + Send) -> T {
    thread::scope(|scope| {
        let role = scope.spawn(role);
        hangs.recv().unwrap();
        stopper.stop();
        role.join().unwrap()
    })
}

fn close(handle: &Handle, link: &mut Link) -> CloseReason {
    loop {
        match handle.block_on(link.frames_rx.recv()) {
            Ok(_) => {}
            Err(RecvError::Closed { reason, .. }) => return reason,
            Err(end) => panic!("{end:?}"),
        }
    }
}

#[test]
fn a_machine_that_waits_for_its_device_ends_when_it_is_asked_to() {
    for task in [Task::Begin, Task::Finish, Task::Test] {
        let house = House::new("unused");
        let (begun, hangs) = channel();
        let handle = house.runtime.handle();
        let device = Device::failing(task, 0, Fault::Hangs(begun));
        let (display, mut to_display) = house.link(Role::FirstCuller, Role::Display);
        let (other, mut to_other) = house.link(Role::FirstCuller, Role::SecondCuller);
        to_display.latest_tx.publish(house.camera.for_frame(FrameNumber(0))).unwrap();
        let (stopper, stop) = Stop::new();
        let role = house.culler(CullerIndex::First, device, display, other, house.settings(0));
        stopped(hangs, stopper, || handle.block_on(role.run(&stop))).unwrap();
        for link in [&mut to_display, &mut to_other] {
            assert_eq!(close(handle, link), CloseCode::Interrupted.reason(), "{task:?}");
        }
    }
}

#[test]
fn a_display_that_waits_for_its_device_ends_when_it_is_asked_to() {
    let house = House::new("unused");
    let (begun, hangs) = channel();
    let handle = house.runtime.handle();
    let device = Device::failing(Task::Draw, 0, Fault::Hangs(begun));
    let (first, mut to_first) = house.link(Role::Display, Role::FirstCuller);
    let (second, mut to_second) = house.link(Role::Display, Role::SecondCuller);
    let camera = house.camera.for_frame(FrameNumber(0));
    handle.block_on(async {
        to_first.frames_tx.begin(FrameStart { frame: FrameNumber(0), header: camera }).await.unwrap();
        to_first.frames_tx.finish().await.unwrap();
    });
    let (stopper, stop) = Stop::new();
    let role = house.display(device, first, second, house.settings(0));
    let mut frames = Frames::default();
    let play = || handle.block_on(role.run(&mut house.still(), &mut frames, &stop));
    stopped(hangs, stopper, play).unwrap();
    assert_eq!(frames.0, [0_u32; 0]);
    for link in [&mut to_first, &mut to_second] {
        assert_eq!(close(handle, link), CloseCode::Interrupted.reason());
    }
}

/// How a display ends whose first machine is due and silent, when the second one leaves with these words or
/// none.
fn left_by_the_other(lockstep: bool, words: Option<CloseReason>) -> RoleError {
    let house = House::new("unused");
    let handle = house.runtime.handle();
    let (first, _silent) = house.link(Role::Display, Role::FirstCuller);
    let (second, mut leaving) = house.link(Role::Display, Role::SecondCuller);
    let settings = Settings { lockstep, frames: lockstep.then_some(FRAMES), ..house.settings(0) };
    let role = house.display(Device::default(), first, second, settings);
    let (_stopper, stop) = Stop::new();
    thread::scope(|scope| {
        let (mut still, mut frames) = (house.still(), Frames::default());
        let ended =
            scope.spawn(move || handle.block_on(role.run(&mut still, &mut frames, &stop)).unwrap_err());
        handle.block_on(async {
            leaving.latest_rx.latest().await.unwrap();
            match words {
                Some(words) => leaving.close(words).await.unwrap(),
                None => drop(leaving),
            }
        });
        ended.join().unwrap()
    })
}

#[test]
fn a_display_does_not_wait_for_one_machine_when_the_other_has_left() {
    for lockstep in [true, false] {
        for words in
            [None, Some(CloseCode::PeerLost.because("it was away")), Some(CloseCode::Interrupted.reason())]
        {
            let end = left_by_the_other(lockstep, words);
            assert!(end.lost_a_peer() && format!("{end:?}").contains("second culler"), "{end:?}");
        }
    }
}
