//! Shared by the tests of roles: a device that may fail, an observer, links, settings.
#![allow(dead_code, reason = "each test file uses its part of this")]

use std::{
    sync::{Arc, mpsc::Sender},
    thread,
    time::Duration,
};

use thiserror::Error;
use tokio::runtime::{Builder, Runtime};
use trimaran_actors::{
    BoxedError, Cameras, CullerDevice, CullerId, FrameStart, Link, LocalSession, Observer, PictureDevice,
    ShownFrame, Stop, max_frame,
};
use trimaran_cook::{
    CookOptions, cook,
    generate::{PlantOptions, plant},
};
use trimaran_cull::{
    Cancel, DepthImage, Image, LodRule, NoOccluders, OcclusionTest, TestBox, View, Viewport,
};
use trimaran_proto::{Camera, DrawableId, FrameNumber, Identity, Role, Settings, Walkthrough};
use trimaran_scene::Scene;
use trimaran_transport::{LinkConfig, Net, inproc};

/// A display's settings for a picture this many pixels high and wide.
pub(crate) fn settings(side: u32, epsilon_px: f64) -> Settings {
    Settings::new(Viewport::new(side, side).unwrap(), LodRule::new(epsilon_px).unwrap())
}

/// A runtime with a thread of its own.
pub(crate) fn runtime() -> Runtime {
    Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap()
}

/// A whole session.
pub(crate) fn play<D: CullerDevice>(
    session: LocalSession,
    device: impl Fn(Option<CullerId>) -> D + Sync,
    screen: impl PictureDevice,
    cameras: &mut dyn Cameras,
    observer: &mut dyn Observer,
) {
    let ((_stopper, stop), runtime) = (Stop::new(), runtime());
    session.run(|id| Ok(device(id)), screen, cameras, observer, runtime.handle(), &stop).unwrap();
}

/// A generated scene.
pub(crate) fn scene(options: &PlantOptions) -> Arc<Scene> {
    Arc::new(cook(&plant(options), &CookOptions::default(), &()).unwrap())
}

pub(crate) fn small_scene() -> Arc<Scene> {
    scene(&PlantOptions::small(3))
}

/// Large enough that each frame has many ids.
pub(crate) fn large_scene() -> Arc<Scene> {
    scene(&PlantOptions { seed: 3, objects: 1_500, triangles: 90_000 })
}

/// The middle of the scene.
pub(crate) fn middle(scene: &Scene) -> [f64; 3] {
    let (min, max) = scene.nodes().first().unwrap().world_box();
    (0.5 * (min + max)).to_array()
}

/// A camera turned to the left by twice this angle.
pub(crate) fn turned(eye: [f64; 3], half: f64, tan_half_fov_y: f32, frame: FrameNumber) -> Camera {
    Camera::new(eye, [0.0, half.sin(), 0.0, half.cos()], tan_half_fov_y, 0.1, frame).unwrap()
}

/// Sends a frame; none if the other end is gone.
pub(crate) async fn send_frame(
    link: &mut Link,
    frame: u32,
    camera: Camera,
    ids: &[DrawableId],
) -> Option<()> {
    let start = FrameStart { frame: FrameNumber(frame), header: camera };
    link.frames_tx.begin(start).await.ok()?;
    for batch in ids.chunks(100) {
        link.frames_tx.push(batch).await.ok()?;
    }
    link.frames_tx.finish().await.ok().map(drop)
}

/// A link within this process between two roles that have this scene.
pub(crate) fn link(net: &Arc<dyn Net>, scene: &Scene, ours: Role, theirs: Role) -> (Link, Link) {
    let identity = |role| Identity { role, scene: Some(scene.outline()), session: None };
    let config = LinkConfig::default().with_max_frame(max_frame(scene));
    inproc::pair::<Walkthrough>(net, identity(ours), identity(theirs), &config).unwrap()
}

/// A device's behaviour at the task that it is to fail at.
#[derive(Debug, Clone)]
pub(crate) enum Fault {
    /// It returns an error.
    Fails(Broken),
    /// A bug.
    Panics,
    /// It hangs unless the role is asked to stop. Signals that it has begun.
    Hangs(Sender<()>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub(crate) enum Broken {
    #[error("the graphics device was lost while drawing")]
    Lost,
    #[error("the graphics device hangs: no progress within 30s")]
    Hung,
    #[error("asked to stop")]
    Cancelled,
    #[error("out of memory while drawing")]
    NoMemory,
}

/// A task of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Task {
    Begin,
    Draw,
    Finish,
    Test,
}

/// A device that finds everything visible, until it fails at a task of this kind.
#[derive(Default)]
pub(crate) struct Device {
    fault: Option<(Task, Fault)>,
    /// How many tasks of that kind succeed.
    good: u32,
    cancel: Option<Cancel>,
}

impl Device {
    pub(crate) fn failing(at: Task, good: u32, fault: Fault) -> Self {
        Self { fault: Some((at, fault)), good, cancel: None }
    }

    fn work(&mut self, task: Task) -> Result<(), Broken> {
        let Some((at, fault)) = &self.fault else { return Ok(()) };
        if *at != task {
            return Ok(());
        }
        if self.good > 0 {
            self.good -= 1;
            return Ok(());
        }
        match fault {
            Fault::Fails(broken) => Err(*broken),
            Fault::Panics => panic!("a bug that only this session meets"),
            Fault::Hangs(begun) => {
                begun.send(()).unwrap();
                let cancel = self.cancel.as_ref().unwrap();
                while !cancel() {
                    thread::yield_now();
                }
                Err(Broken::Cancelled)
            }
        }
    }
}

impl CullerDevice for Device {
    fn is_lost(error: &Broken) -> bool {
        matches!(error, Broken::Lost | Broken::Hung)
    }

    fn cancel_on(&mut self, cancel: &Cancel) {
        self.cancel = Some(Arc::clone(cancel));
    }

    fn begin_occluders(&mut self, _: &View) -> Result<(), Broken> {
        self.work(Task::Begin)
    }

    fn draw_occluders(&mut self, _: &[DrawableId]) -> Result<(), Broken> {
        self.work(Task::Draw)
    }

    fn finish_occluders(&mut self) -> Result<(), Broken> {
        self.work(Task::Finish)
    }

    fn read_depth(&mut self) -> Result<DepthImage<'_>, Broken> {
        panic!("nobody looks at the depth here")
    }
}

impl OcclusionTest for Device {
    type Error = Broken;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Broken> {
        NoOccluders.test(view, boxes, visible).unwrap_or_else(|never| match never {});
        self.work(Task::Test)
    }
}

impl PictureDevice for Device {
    type Error = Broken;

    fn cancel_on(&mut self, cancel: &Cancel) {
        self.cancel = Some(Arc::clone(cancel));
    }

    fn draw(&mut self, _: &View, _: &[DrawableId], _: &[DrawableId]) -> Result<Duration, Broken> {
        self.work(Task::Draw).map(|()| Duration::ZERO)
    }

    fn read(&mut self, _: &mut Image) -> Result<(), Broken> {
        panic!("nobody wants a picture here")
    }
}

/// A note of each frame shown.
#[derive(Debug, Default)]
pub(crate) struct Frames(pub(crate) Vec<u32>);

impl Observer for Frames {
    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.0.push(frame.camera.frame().0);
        Ok(())
    }
}
